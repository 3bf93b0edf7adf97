"""Fig. 3: the online stage as a diagram."""

from sdhj.figures import script

if __name__ == "__main__":
    script(3)()

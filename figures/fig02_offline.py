"""Fig. 2: the offline stage as a diagram."""

from sdhj.figures import script

if __name__ == "__main__":
    script(2)()

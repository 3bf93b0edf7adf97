"""Fig. 5: the two teams as a diagram."""

from sdhj.figures import script

if __name__ == "__main__":
    script(5)()

"""Every figure, one after the other; what they share is solved once."""

from sdhj.figures import script

if __name__ == "__main__":
    script()()

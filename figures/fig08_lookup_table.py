"""Fig. 8: the look-up table as small slices, and a run's way through it."""

from sdhj.figures import script

if __name__ == "__main__":
    script(8)()

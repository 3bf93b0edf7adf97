"""Share of the joint configuration space inside the tubes, by method."""

from sdhj.figures import script

if __name__ == "__main__":
    script("extra_fractions")()

"""Fig. 7: the reach-avoid set and the cost whose zero level bounds it, solved, and defeating adversaries."""

from sdhj.figures import script

if __name__ == "__main__":
    script(7)()

"""Fig. 6: the reach set of one input, solved, and runs from inside and outside it."""

from sdhj.figures import script

if __name__ == "__main__":
    script(6)()

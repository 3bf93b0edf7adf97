"""Fig. 11: the same tubes by projections."""

from sdhj.figures import script

if __name__ == "__main__":
    script(11)()

"""Fig. 14: computation times beside the paper's, measured now."""

from sdhj.figures import script

if __name__ == "__main__":
    script(14)()

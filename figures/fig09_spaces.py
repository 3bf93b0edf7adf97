"""Fig. 9: workspace and configuration space."""

from sdhj.figures import script

if __name__ == "__main__":
    script(9)()

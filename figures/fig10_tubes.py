"""Fig. 10: the reach-avoid tubes from step 0."""

from sdhj.figures import script

if __name__ == "__main__":
    script(10)()

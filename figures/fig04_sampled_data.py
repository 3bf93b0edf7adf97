"""Fig. 4: a run's state, its samples, and the input held between them."""

from sdhj.figures import script

if __name__ == "__main__":
    script(4)()

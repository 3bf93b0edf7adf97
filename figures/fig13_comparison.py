"""Fig. 13: full and projected tubes laid over each other, and as surfaces in three axes."""

from sdhj.figures import script

if __name__ == "__main__":
    script(13)()

"""The evading target (Sec. 6.1)."""

from sdhj.figures import script

if __name__ == "__main__":
    script("extra_evader")()

"""The victory domain shrinks to nothing as the adversary's bounds grow (Sec. 6.1)."""

from sdhj.figures import script

if __name__ == "__main__":
    script("extra_adversary")()

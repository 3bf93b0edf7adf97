"""View-times, and the collisions that samples let through (Sec. 5.4 and 6.2.1)."""

from sdhj.figures import script

if __name__ == "__main__":
    script("extra_view_time")()

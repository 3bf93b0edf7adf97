"""What projecting costs: volume ratio and Hausdorff distance of every tube."""

from sdhj.figures import script

if __name__ == "__main__":
    script("extra_conservativeness")()

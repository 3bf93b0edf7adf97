"""What projecting costs: volume ratio and Hausdorff distance of every tube."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command("extra_conservativeness")()

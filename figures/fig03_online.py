"""Fig. 3: the online stage as a diagram."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(3)()

"""Fig. 9: workspace and configuration space."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(9)()

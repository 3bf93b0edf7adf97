"""Fig. 7: the reach-avoid set and the cost whose zero level bounds it, solved, and defeating adversaries."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(7)()

"""Fig. 14: computation times beside the paper's, measured now."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(14)()

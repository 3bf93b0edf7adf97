"""Fig. 5: the two teams as a diagram."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(5)()

"""Fig. 8: the look-up table as small slices, and a run's way through it."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(8)()

"""Every figure, one after the other; what they share is solved once."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command()()

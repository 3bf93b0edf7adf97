"""Fig. 6: the reach set of one input, solved, and runs from inside and outside it."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(6)()

"""Fig. 11: the same tubes by projections."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(11)()

"""Fig. 4: a run's state, its samples, and the input held between them."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(4)()

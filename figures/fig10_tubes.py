"""Fig. 10: the reach-avoid tubes from step 0."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(10)()

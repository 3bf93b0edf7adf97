"""Share of the joint configuration space inside the tubes, by method."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command("extra_fractions")()

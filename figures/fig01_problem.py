"""Fig. 1: the problem: a robot arm, known moving disks, an unpredictable agent."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(1)()

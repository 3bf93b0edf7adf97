"""Fig. 13: full and projected tubes laid over each other, and as surfaces in three axes."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(13)()

"""Fig. 12: a run in workspace and configuration space, with an animation."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command(12)()

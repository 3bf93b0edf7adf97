"""The evading target (Sec. 6.1)."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command("extra_evader")()

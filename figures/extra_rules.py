"""Selection rules trade effort, clearance and time (Sec. 6.1)."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command("extra_rules")()

"""View-times, and the collisions that samples let through (Sec. 5.4 and 6.2.1)."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command("extra_view_time")()

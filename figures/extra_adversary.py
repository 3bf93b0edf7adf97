"""The victory domain shrinks to nothing as the adversary's bounds grow (Sec. 6.1)."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command("extra_adversary")()

"""What more input levels bring and cost (Sec. 6.1)."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command("extra_input_levels")()

"""What is certified: the share of C against the number of cells, and a slice of it in an interpolated tube."""

from sdhj.cli import figure_command

if __name__ == "__main__":
    figure_command("extra_certified")()

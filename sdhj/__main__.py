"""`python -m sdhj` runs the command `sdhj`."""

from sdhj.cli import command

command()

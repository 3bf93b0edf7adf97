"""`python -m sdhj` is the command `sdhj`."""

from sdhj.cli import command

command()

"""`python -m sdhj` is the command `sdhj`."""

from sdhj.cli import main

main(prog_name="sdhj")

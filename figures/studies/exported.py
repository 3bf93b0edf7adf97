"""How large a certified table is in C: rows of the page on robots, of the README's car.

python figures/studies/exported.py            the rows of the page, some minutes
python figures/studies/exported.py 64,64,63   one of them
"""

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import click

import sdhj
from sdhj.certified.export import FIELDS
from sdhj.cli import plainly

sys.path.append(str(Path(__file__).parents[1]))  # the scripts are no package to install

import extra_sensing

CELLS = ("64,64,63", "120,120,126", "240,240,340", "594,594,277")
ROW = "| {cells} | {share:.3f} | {all:,.0f} kB | {select:,.0f} kB | {each:.2f} µs |"


def row(cells: tuple[int, ...]) -> str:
    """What is proved of the car at so many cells, its two files, and the CPU time of packing a cell."""
    table = sdhj.solve(extra_sensing.car(), sdhj.Certified(cells=cells), play=False)
    sizes, began = {}, 0.0
    with TemporaryDirectory() as folder:
        for name, only in (("select", ("select",)), ("all", FIELDS)):
            began = time.process_time()
            sdhj.export_c(table, Path(folder, name), only=only, progress=False)
            sizes[name] = Path(folder, name, "sdhj_table.bin").stat().st_size / 1e3
        each = (time.process_time() - began) / table.cells.counts.prod() * 1e6
    shape = " x ".join(map(str, table.shape))
    return ROW.format(cells=shape, share=table.fraction(), each=each, **sizes)


@click.command()
@click.argument("cells", nargs=-1)
@plainly
def main(cells: tuple[str, ...]) -> None:
    """Print a row for each number of cells, such as 64,64,63."""
    click.echo(
        "| cells | share proved | everything | `--only select` | packing a cell |\n| --- | --- | --- | --- | --- |"
    )
    for one in cells or CELLS:
        click.echo(row(tuple(map(int, one.split(",")))))


if __name__ == "__main__":
    main()

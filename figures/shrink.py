"""Pictures for the site's gallery, made small from those in a folder: python figures/shrink.py results 25.

The number, of nodes on each axis of the arm, is kept in the files that show what was computed on them, and said beside
the pictures.
"""

import re
import sys
from collections.abc import Sequence
from pathlib import Path

from common import HERE, NAMES
from PIL import Image
from PIL.PngImagePlugin import PngInfo

WIDTH, COLOURS = 700, 128
WIDE = {"extra_overview": 1100, "fig10_tubes": 1100}  # at the top of a page
# how a script asks for what is computed on the arm's grid
ON_NODES = re.compile(r"\bcontext\.(table|run|shares|nodes)\b")


def shrink(folder: Path, names: Sequence[str] = NAMES, *, nodes: str = "", printed: str = "") -> None:
    """Put each figure that the folder holds as PNG into figures/gallery/, with its nodes, or the digest `printed`."""
    for path in (folder / f"{name}.png" for name in names if name in NAMES):
        if path.is_file():
            with Image.open(path) as image:
                small = image.convert("RGB")
            width = WIDE.get(path.stem, WIDTH)
            small.thumbnail((width, width))
            told = PngInfo()
            if printed:
                told.add_text("printed", printed)
            if nodes and ON_NODES.search((HERE / f"{path.stem}.py").read_text("utf-8")):
                told.add_text("nodes", nodes)
            small.quantize(COLOURS).save(HERE / "gallery" / path.name, optimize=True, pnginfo=told)


if __name__ == "__main__":
    shrink(Path(sys.argv[1]), nodes=sys.argv[2])

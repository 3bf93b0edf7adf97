"""Pictures for the site's gallery, made small from those in a folder: python figures/shrink.py results."""

import sys
from pathlib import Path

from common import HERE, NAMES
from PIL import Image

WIDTH, COLOURS = 700, 128
WIDE = {"extra_overview": 1100, "fig10_tubes": 1100}  # at the top of a page


def shrink(folder: Path) -> None:
    """Put each figure that the folder holds as PNG into figures/gallery/."""
    for path in (folder / f"{name}.png" for name in NAMES):
        if path.is_file():
            with Image.open(path) as image:
                small = image.convert("RGB")
            width = WIDE.get(path.stem, WIDTH)
            small.thumbnail((width, width))
            small.quantize(COLOURS).save(HERE / "gallery" / path.name, optimize=True)


if __name__ == "__main__":
    shrink(Path(sys.argv[1]))

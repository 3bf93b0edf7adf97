"""Make the README's small pictures: of each notebook, the largest picture among its committed outputs.

Usage: python .ci/gallery.py
"""

import base64
import io
import json
from pathlib import Path

from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
SIZE = (420, 420)
COLOURS = 64


def pictures(path: Path) -> list[bytes]:
    """The PNG outputs of a notebook."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    outputs = [output for cell in cells for output in cell.get("outputs", [])]
    found = [output["data"]["image/png"] for output in outputs if "image/png" in output.get("data", {})]
    return [base64.b64decode(png if isinstance(png, str) else "".join(png)) for png in found]


def main() -> None:
    """Write figures/gallery/<notebook>.png for every notebook that has a picture."""
    folder = ROOT / "figures" / "gallery"
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        if found := pictures(path):
            image = Image.open(io.BytesIO(max(found, key=len))).convert("RGB")
            image.thumbnail(SIZE)
            image.quantize(COLOURS).save(folder / f"{path.stem}.png", optimize=True)


if __name__ == "__main__":
    main()

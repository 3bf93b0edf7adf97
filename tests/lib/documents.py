"""README and the pages of the site, as their tests read them."""

import re
from pathlib import Path

import keep

ROOT = Path(__file__).parents[2]


def blocks(path: Path, heading: str = "") -> list[str]:
    """The Python of a page, or of that section of it whose heading is given."""
    text = path.read_text(encoding="utf-8")
    if heading:
        (text,) = (part for part in re.split(r"^(?=## )", text, flags=re.MULTILINE) if part.startswith(heading))
    return re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def named_files(path: Path) -> list[Path]:
    """What a page links to or shows, and the scripts that it runs; not addresses on the web."""
    text = path.read_text(encoding="utf-8")
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text) + re.findall(r'src="([^"]+)"', text)
    return [path.parent / link for link in links] + [ROOT / name for name in re.findall(r"python (\S+\.py)", text)]


def column(name: str, title: str, row: str = "") -> list[str]:
    """The cells of one column of a kept table, in rows that begin with some text."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in keep.kept(name) if line.startswith("|")]
    return [cells[rows[0].index(title)] for cells in rows[2:] if " | ".join(cells).startswith(row)]

"""The notebooks as they are committed: whole, fresh, small; and the tool that says so.

That their numbers still come out is checked by running them: pytest --nbval-lax notebooks/
"""

import base64
import io
import itertools
import json
import re
import runpy
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import nbformat
import pytest
from PIL import Image

ROOT = Path(__file__).parent.parent.parent
CHAPTERS = sorted((ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb"))
TOOL = runpy.run_path(str(ROOT / ".ci" / "notebooks.py"))
READING = ROOT / "notebooks" / "site" / "reading.md"
CITED = re.compile(r"Eqs?\. \(\d|Definition \d|Theorem \d|Proposition \d|App\. A|Sec\. \d|Figs?\. \d|Algorithm \d")


def read(path: Path) -> Any:
    return nbformat.read(path, as_version=4)


def prose(path: Path) -> str:
    return "\n".join(cell.source for cell in read(path).cells if cell.cell_type == "markdown")


def code(path: Path) -> str:
    return "\n".join(cell.source for cell in read(path).cells if cell.cell_type == "code")


def test_the_series_is_complete() -> None:
    assert [path.name[:2] for path in CHAPTERS] == [f"{number:02d}" for number in range(1, len(CHAPTERS) + 1)]


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_every_chapter_has_its_parts(path: Path) -> None:
    text = prose(path)
    title, question, shown = text.split("\n\n")[:3]
    assert title.startswith(f"# {int(path.name[:2])}. ") and question.startswith("**Question.**")
    assert re.fullmatch(rf"!\[.+\]\(gallery/{path.stem}\.png\)", shown)
    for part in (
        "**Before:**",
        "**After:**",
        "**What to notice",
        "**In the library:**",
        "## Exercises",
        "$$",
    ):
        assert part in text, f"{path.name} lacks {part}"
    assert CITED.search(text), f"{path.name} cites nothing of the paper"
    assert re.search(r"^explore_\w+\(", code(path), re.MULTILINE), f"{path.name} has no widget"
    cells = [cell for cell in read(path).cells if cell.cell_type == "code"]
    pinned = [cell for cell in cells if "nbval-check-output" in cell.metadata.get("tags", [])]
    assert pinned, f"{path.name} pins no number"
    for cell in pinned:
        assert cell.outputs and all(output.output_type == "stream" for output in cell.outputs)
        assert "print(" in cell.source
    shown = [output.data for cell in cells for output in cell.outputs if output.output_type == "display_data"]
    assert not any(kind.startswith("image/") for data in shown for kind in data), f"{path.name}: pictures go as HTML"
    pictures = [tag for data in shown for tag in re.findall(r"<img [^>]*>", data.get("text/html", ""))]
    assert len(pictures) >= 2
    assert all(re.search(r' alt="[^"]', tag) for tag in pictures), f"{path.name} has a picture without words"


def strips(path: Path) -> list[Any]:
    return json.loads(TOOL["frames_file"](path).read_text("utf-8"))["widgets"]


@pytest.mark.parametrize("path", CHAPTERS, ids=lambda path: path.stem)
def test_the_sites_sliders_show_what_the_text_beside_them_says(path: Path) -> None:
    """Some twenty frames: the first setting, what is named, and numbers beside its name in the text around."""
    found, cells = strips(path), read(path).cells
    shown = [
        place for place, cell in enumerate(cells) if TOOL["WIDGET"].search(cell.source) and cell.cell_type == "code"
    ]
    assert [number for number, _ in itertools.groupby(strip["widget"] for strip in found)] == [
        number + 1 for number in range(len(shown))
    ]
    for strip in found:
        values, place = strip["values"], shown[strip["widget"] - 1]
        assert {strip["at"], *strip["named"]} <= set(values), strip["file"]
        around = " ".join(cell.source for cell in cells[place - 1 : place + 2] if cell.cell_type == "markdown")
        for name in re.sub(r" \(.*\)", "", strip["control"]).split(", "):
            said = re.findall(rf"\b(\d[\d.]*\d|\d) {name}|{name} of (\d+)", around)
            assert {float(a or b) for a, b in said} <= set(map(float, values)), f"{strip['file']}: {name} {said}"


def keys() -> list[str]:
    """The entries of the reading list as links name them: their headings, made anchors of as GitHub and the site do."""
    headings = re.findall(r"^### (.+)$", READING.read_text(encoding="utf-8"), re.MULTILINE)
    return [re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings]


def test_the_reading_list_has_each_source_once_and_what_chapters_cite() -> None:
    cited = [set(re.findall(r"\]\(site/reading\.md#([^)]+)\)", prose(path))) for path in CHAPTERS]
    assert len(keys()) == len(set(keys())) and set(map(unquote, set[str]().union(*cited))) == set(keys())
    assert all(cited), "a chapter cites nothing"


def notebook(source: str = "print(1)", prose_text: str = "# 1. Title") -> Any:
    new = nbformat.v4
    return new.new_notebook(cells=[new.new_markdown_cell(prose_text), new.new_code_cell(source)])


@pytest.mark.slow
def test_executed_notebooks_are_fresh_until_their_code_changes(tmp_path: Path) -> None:
    path = tmp_path / "01_new.ipynb"
    nbformat.write(notebook(source="x = 1"), path)
    assert "stale" in TOOL["faults"](path)[0]
    TOOL["execute"](path)
    assert TOOL["faults"](path) == []
    before = path.read_bytes()
    TOOL["execute"](path)
    assert path.read_bytes() == before
    path.write_text(path.read_text().replace("x = 1", "x = 2"))
    assert "stale" in TOOL["faults"](path)[0]


def test_faults_are_found(tmp_path: Path) -> None:
    bad = notebook("def f():\n    pass")
    view = {TOOL["VIEW"]: {"model_id": "x"}}
    bad.cells[1].outputs = [
        nbformat.v4.new_output("error", ename="E", evalue="e", traceback=[]),
        nbformat.v4.new_output("stream", name="stderr", text="warning"),
        nbformat.v4.new_output("display_data", data=view),
        nbformat.v4.new_output("stream", name="stdout", text="Exercise 1.1: right.\n"),
        nbformat.v4.new_output("stream", name="stdout", text="x" * TOOL["LARGEST"]),
    ]
    path = tmp_path / "bad.ipynb"
    nbformat.write(bad, path)
    found = "\n".join(TOOL["faults"](path))
    for said in ("stale", "top to bottom", "error or a warning", "widget without", "holds an answer", "kB, more than"):
        assert said in found
    assert "function" not in found  # they are wanted where they teach
    assert TOOL["main"](["check", str(path)]) == 1
    assert TOOL["main"](["paint"]) == 2


def test_cleaning_leaves_what_is_the_same_on_every_run() -> None:
    dirty = notebook()
    dirty.metadata["widgets"] = {"state": {}}
    dirty.cells[1].metadata = nbformat.from_dict({"execution": {"time": 1}, "tags": ["nbval-check-output"]})
    buffer = io.BytesIO()
    Image.effect_noise((50, 50), 80).convert("RGBA").save(buffer, "png")
    encoded = base64.b64encode(buffer.getvalue()).decode()
    picture = {"text/html": f'<img src="data:image/png;base64,{encoded}" alt="a > b">'}
    dirty.cells[1].outputs = [
        nbformat.v4.new_output("stream", name="stdout", text="a"),
        nbformat.v4.new_output("stream", name="stdout", text="b"),
        nbformat.v4.new_output("display_data", data={TOOL["VIEW"]: {}, "text/plain": "Controls"}),
        nbformat.v4.new_output("display_data", data=picture),
    ]
    TOOL["clean"](dirty)
    first, panel, drawing = dirty.cells[1].outputs
    assert first.text == "ab"
    assert panel.data == {"text/plain": "Controls"}
    (kept,) = TOOL["PICTURE"].findall(drawing.data["text/html"])
    assert Image.open(io.BytesIO(base64.b64decode(kept))).mode == "P"
    assert drawing.data["text/html"] == picture["text/html"].replace(encoded, kept)
    assert dirty.cells[1].metadata == {"tags": ["nbval-check-output"]}
    assert set(dirty.metadata) == {"kernelspec", "language_info", "sdhj"}

"""Execute the notebooks and keep what they say, or check that what they say is not stale.

Usage: python .ci/notebooks.py execute [NOTEBOOK...]     (default: all of notebooks/)
       python .ci/notebooks.py check [NOTEBOOK...]
       python .ci/notebooks.py gallery
       python .ci/notebooks.py solutions [NOTEBOOK...]

`execute` runs every cell in a fresh kernel. What it writes has no times of cells, no widget state and no versions, and
records a hash of the code it ran. `check`, the pre-commit hook, runs nothing: it says which notebooks hold other code
than they were executed with, an error, an exercise that is already answered, or more than a reader should have to load.
`gallery` writes the picture of each notebook's cell tagged "gallery" to notebooks/gallery/, for the README; `execute`
does so too, and writes some frames of each widget to notebooks/site/_static/frames/, for the site. `solutions` puts
below each exercise its solution, from notebooks/solutions/, folded.

That the numbers still come out is what `pytest --nbval-lax notebooks/` checks.
"""

import ast
import base64
import hashlib
import io
import json
import re
import sys
from pathlib import Path
from typing import Any

import nbformat
from nbclient import NotebookClient
from PIL import Image

FOLDER = Path(__file__).resolve().parent.parent / "notebooks"
LARGEST = 600_000  # bytes
ANSWERED = re.compile(r"^Exercise [0-9.]+: (?!not answered yet)", re.MULTILINE)
SOLUTION = "<details><summary>Solution</summary>"
CHECK = re.compile(r"^(check_\w+)\(", re.MULTILINE)
PICTURE = re.compile(r'(?<=<img src="data:image/png;base64,)[^"]+')
WIDGET = re.compile(r"^explore_\w+\(", re.MULTILINE)
VIEW = "application/vnd.jupyter.widget-view+json"
METADATA = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def code_hash(notebook: nbformat.NotebookNode) -> str:
    """SHA-256 of the code cells."""
    parts = [cell.source for cell in notebook.cells if cell.cell_type == "code"]
    return hashlib.sha256("\0".join(parts).encode()).hexdigest()


def joined(outputs: list[Any]) -> list[Any]:
    """Outputs with neighbouring pieces of the same stream made one: how they were cut is chance."""
    kept: list[Any] = []
    for output in outputs:
        if kept and output.output_type == "stream" and kept[-1].get("name") == output.name:
            kept[-1].text += output.text
        else:
            kept.append(output)
    return kept


def small(png: str) -> str:
    """A picture (base64) with a palette of 256 colours: half the size, and no difference to the eye in a drawing."""
    image = Image.open(io.BytesIO(base64.b64decode(png)))
    if image.mode == "P":
        return png
    buffer = io.BytesIO()
    image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(buffer, "png", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode()


def clean(notebook: nbformat.NotebookNode) -> None:
    """Leave what is the same on every run, in place."""
    for cell in notebook.cells:
        kept = {"tags": cell.metadata.tags} if "tags" in cell.metadata else {}
        cell.metadata = nbformat.from_dict(kept)
        if cell.cell_type == "code":
            cell.outputs = joined(cell.outputs)
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            data.pop(VIEW, None)
            if "text/html" in data:
                data["text/html"] = PICTURE.sub(lambda found: small(found[0]), data["text/html"])
    notebook.metadata = nbformat.from_dict({**METADATA, "sdhj": {"code": code_hash(notebook)}})


def frames_file(path: Path) -> Path:
    """What the site's frames of a notebook's widgets say; their pictures lie beside it."""
    return path.parent / "site" / "_static" / "frames" / f"{path.stem}.json"


def has_widgets(notebook: nbformat.NotebookNode) -> bool:
    """Whether a cell calls explore_something on a line of its own."""
    return any(WIDGET.search(cell.source) for cell in notebook.cells if cell.cell_type == "code")


def execute(path: Path) -> None:
    """Run a notebook and write it back; where it has widgets, their frames too."""
    notebook = nbformat.read(path, as_version=4)
    if has_widgets(notebook):
        frames_file(path).parent.mkdir(parents=True, exist_ok=True)
        given = f"Path({str(frames_file(path).parent)!r}), {path.stem!r}, {code_hash(notebook)!r}"
        last = "import sys\nfrom pathlib import Path\n\nsys.path.append('site')\nfrom frames import write_frames\n\n"
        last += f"write_frames({given})"
        notebook.cells.append(nbformat.v4.new_code_cell(last))
    options = {"timeout": 900, "store_widget_state": False, "record_timing": False, "kernel_name": "python3"}
    NotebookClient(notebook, resources={"metadata": {"path": str(path.parent)}}, **options).execute()
    if has_widgets(notebook):
        notebook.cells.pop()
    clean(notebook)
    nbformat.write(notebook, path)


def solutions_file(path: Path) -> Path:
    """Where the solutions of a notebook's exercises stand."""
    return path.parent / "solutions" / f"solution_{path.name[:2]}.py"


def solution_of(tree: ast.Module, lines: list[str], check: str) -> str:
    """The source of the answer that a file of solutions has for a check, and of what of the file it uses."""
    made: dict[str, tuple[int, ast.stmt]] = {}
    above = 0
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [node]
        for name in (getattr(target, "id", getattr(target, "name", "")) for target in targets):
            made[name] = above, node
        above = node.end_lineno or 0
    right = made["RIGHT"][1]
    assert isinstance(right, ast.Assign) and isinstance(right.value, ast.Dict)
    answers = zip(right.value.keys, right.value.values, strict=True)
    wanted = [answer for key, answer in answers if getattr(key, "id", "") == check]
    needed, seen = set[str](), [node.id for one in wanted for node in ast.walk(one) if isinstance(node, ast.Name)]
    while seen:
        if (name := seen.pop()) in made and name not in needed:
            needed.add(name)
            seen += [node.id for node in ast.walk(made[name][1]) if isinstance(node, ast.Name)]
    parts = {made[name][0]: "\n".join(lines[made[name][0] : made[name][1].end_lineno]).strip("\n") for name in needed}
    return "\n\n".join(parts[place] for place in sorted(parts)) or "\n".join(map(ast.unparse, wanted))


def with_solutions(path: Path) -> str:
    """A notebook, as text, with the solutions of its exercises, each folded below its cell."""
    notebook, text = nbformat.read(path, as_version=4), solutions_file(path).read_text("utf-8")
    tree, cells = ast.parse(text), []
    for cell in notebook.cells:
        if cell.source.startswith(SOLUTION):
            continue
        cells.append(cell)
        if cell.cell_type == "code" and (check := CHECK.search(cell.source)):
            code = solution_of(tree, text.splitlines(), check[1])
            folded = nbformat.v4.new_markdown_cell(f"{SOLUTION}\n\n```python\n{code}\n```\n\n</details>")
            folded["id"] = hashlib.sha256(check[1].encode()).hexdigest()[:8]  # the same on every run
            cells.append(folded)
    notebook.cells = cells
    written: str = nbformat.writes(notebook)
    return written if written.endswith("\n") else written + "\n"


def picture(notebook: nbformat.NotebookNode) -> bytes | None:
    """The last picture of the cell tagged "gallery"."""
    outputs = [o for cell in notebook.cells if "gallery" in cell.metadata.get("tags", []) for o in cell.outputs]
    pictures = [png for output in outputs for png in PICTURE.findall(output.get("data", {}).get("text/html", ""))]
    return base64.b64decode(pictures[-1]) if pictures else None


def gallery_file(path: Path) -> Path:
    """Where a notebook's picture for the README lies."""
    return path.parent / "gallery" / f"{path.stem}.png"


def write_gallery(path: Path) -> None:
    """Write a notebook's picture for the README, where it has one."""
    if (png := picture(nbformat.read(path, as_version=4))) is not None:
        gallery_file(path).parent.mkdir(exist_ok=True)
        gallery_file(path).write_bytes(png)


def faults(path: Path) -> list[str]:
    """What is wrong with a notebook as it stands; empty where nothing is."""
    notebook = nbformat.read(path, as_version=4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    found = []
    if notebook.metadata.get("sdhj", {}).get("code") != code_hash(notebook):
        found.append(f"stale: its code has changed; run python .ci/notebooks.py execute {path.name}")
    if [cell.execution_count for cell in code] != list(range(1, len(code) + 1)):
        found.append("was not run from top to bottom")
    for number, cell in enumerate(code, start=1):
        for output in cell.outputs:
            if output.output_type == "error" or output.get("name") == "stderr":
                found.append(f"cell {number} has an error or a warning in its output")
            if VIEW in output.get("data", {}):
                found.append(f"cell {number} holds a widget without its kernel")
            if ANSWERED.search(output.get("text", "")):
                found.append(f"cell {number} holds an answer to an exercise, where its stub should be")
    shown = gallery_file(path).read_bytes() if gallery_file(path).is_file() else None
    if shown != picture(notebook):
        found.append("has another picture than its gallery file; run python .ci/notebooks.py gallery")
    told = json.loads(frames_file(path).read_text("utf-8")) if frames_file(path).is_file() else {}
    if has_widgets(notebook) and told.get("code") != code_hash(notebook):
        found.append(f"has frames of other code; run python .ci/notebooks.py execute {path.name}")
    if solutions_file(path).is_file() and path.read_text("utf-8") != with_solutions(path):
        found.append(f"has other solutions than solutions/; run python .ci/notebooks.py solutions {path.name}")
    if path.stat().st_size > LARGEST:
        found.append(f"is {path.stat().st_size // 1000} kB, more than {LARGEST // 1000}")
    return found


def main(arguments: list[str]) -> int:
    """Do what the command line says; the exit status."""
    if not arguments or arguments[0] not in ("execute", "check", "gallery", "solutions"):
        print(__doc__, file=sys.stderr)
        return 2
    paths = [path.resolve() if path.exists() else FOLDER / path.name for path in map(Path, arguments[1:])] or sorted(
        FOLDER.glob("*.ipynb")
    )
    bad = 0
    for path in paths:
        if arguments[0] == "execute":
            print(path.name, flush=True)
            execute(path)
        if arguments[0] == "solutions":
            path.write_text(with_solutions(path), "utf-8")
        elif arguments[0] != "check":
            write_gallery(path)
        for fault in faults(path):
            print(f"{path.name}: {fault}", file=sys.stderr)
            bad += 1
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

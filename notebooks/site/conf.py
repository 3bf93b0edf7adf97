"""Sphinx: the course as a site, from the executed notebooks; nothing is run.

pip install -e '.[docs]'
python -m sphinx -c notebooks/site notebooks build/site
"""

import ast
import html
import itertools
import json
import os
import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import sdhj

project = "sdhj"
author = "The sdhj authors"
project_copyright = "The sdhj authors"
version = release = sdhj.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx-mathjax-offline",  # MathJax and its fonts come with it: no page asks the network for anything
]
exclude_patterns = ["gallery", "solutions", "**.ipynb_checkpoints"]
default_role = "code"

nb_execution_mode = "off"
nb_merge_streams = True
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
myst_dmath_double_inline = True
myst_html_meta = {
    "description": "Robust motion planning by sampled-data Hamilton-Jacobi reachability: library and course"
}
mathjax3_config = {"options": {"enableMenu": False}}
suppress_warnings = ["myst.header", "mystnb.unknown_mime_type", "ref.python"]  # a shape, (runs, ndim), names nothing

autodoc_member_order = "bysource"
autodoc_typehints = "none"
autodoc_mock_imports = [] if find_spec("gymnasium") else ["gymnasium"]
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "pydata_sphinx_theme"
html_title = "sdhj"
html_static_path = ["_static"]
html_favicon = "_static/sdhj.svg"
templates_path = ["_templates"]
html_css_files = ["wide.css"]
html_js_files = ["frames.js", "page.js"]
FRAMES = Path(__file__).resolve().parent / "_static" / "frames"
LIVE = "Controls, live where the notebook runs"  # how what a widget says without a kernel begins
CHAPTERS = {int(path.name[:2]): path for path in Path(__file__).parent.parent.glob("[0-9][0-9]_*.ipynb")}
TAG = re.compile(r"\\tag\{([^}]+)\}")
TAGS = {
    tag: path.stem
    for path in CHAPTERS.values()
    for cell in json.loads(path.read_text("utf-8"))["cells"]
    for tag in TAG.findall("".join(cell["source"]))
}
MENTIONED = re.compile(r"(\([0-9]{1,2}\.[0-9]{1,2}'?\)|\b[Cc]hapters? [0-9]+(?:(?:,|,? and| to) [0-9]+)*)")
ONE = re.compile(r"(\(.*\)|(?:[Cc]hapters? )?[0-9]+)")  # of what is mentioned
UNLINKED = "title", "reference", "literal", "literal_block", "math", "math_block", "raw"  # nodes of docutils
html_sidebars = {"**": ["globaltoc.html"]}
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_center": ["topbar"],  # the chapters stand at the left
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "search_bar_text": "Search",
    "pygments_light_style": "tango",
}


def as_page(app: Any, docname: str, source: list[str]) -> None:
    """Make a page of a notebook: its file is linked, and widgets have frames."""
    path = Path(os.fspath(app.env.doc2path(docname)))
    if path.suffix != ".ipynb":
        return
    notebook = json.loads(source[0])
    link_to_notebook(notebook, path.name)
    frames = FRAMES / f"{path.stem}.json"
    strips = json.loads(frames.read_text("utf-8"))["widgets"] if frames.is_file() else []
    told = (list(group) for _, group in itertools.groupby(strips, lambda strip: strip["widget"]))
    for cell in notebook["cells"]:
        fold_imports(cell)
        outputs = cell.get("outputs", [])
        if any(is_panel(output) for output in outputs) and (widget := next(told, None)):
            put_frames(outputs, widget)
    source[0] = json.dumps(notebook)


def with_directives(app: Any, docname: str, source: list[str]) -> None:
    """What only the site shows stands in comments, `<!-- {name} ... -->`; links to what is included are for others."""
    source[0] = re.sub(r"^\[.+\]\(.+\)\n\n(?=<!-- \{include\})", "", source[0], flags=re.MULTILINE)
    source[0] = re.sub(r"^<!-- (\{[\w-]+\}.*?)-->$", r"```\1```", source[0], flags=re.MULTILINE | re.DOTALL)
    if docname == "site/api":
        source[0] = re.sub(r"^- \[(sdhj[\w.]*)\]\(\.\./[^)]*\)", r"- {py:obj}`\1`", source[0], flags=re.MULTILINE)


def link_to_notebook(notebook: Any, name: str) -> None:
    """A link to the file below the page's title."""
    title, *rest = "".join(notebook["cells"][0]["source"]).split("\n\n", 1)
    link = f"{{download}}`{name} <{name}>` is this page as a notebook, to run from `notebooks/` with its sliders live."
    notebook["cells"][0]["source"] = "\n\n".join([title, link, *rest])


def fold_imports(cell: Any) -> None:
    """A cell that does little but import is folded."""
    if cell["cell_type"] != "code":
        return
    body = ast.parse("".join(cell["source"])).body
    if 2 * sum(isinstance(one, ast.Import | ast.ImportFrom) for one in body) > len(body):
        cell["metadata"]["tags"] = [*cell["metadata"].get("tags", []), "hide-input"]
        cell["metadata"].setdefault("mystnb", {})["code_prompt_show"] = "Show imports"


def is_panel(output: Any) -> bool:
    """Whether an output is what a widget says in place of its controls."""
    return "".join(output.get("data", {}).get("text/plain", "")).startswith(LIVE)


def put_frames(outputs: list[Any], strips: list[Any]) -> None:
    """A slider through some pictures, for each control that has them, in place of the one that waits for a kernel."""
    panel = next(output for output in outputs if is_panel(output))
    picture = outputs[outputs.index(panel) + 1]
    outputs.remove(panel)
    picture["data"] = {"text/html": "\n".join(as_figure(strip) for strip in strips)}


def as_figure(strip: Any) -> str:
    """The frames of one control: a window on the strip, a button to play it, a slider, a table of what it says."""
    (width, height), count = strip["size"], len(strip["values"])
    at = strip["values"].index(strip["at"])
    told, label, alt = (html.escape(text) for text in (json.dumps(strip), strip["control"], strip["alt"]))
    moved = f"transform: translateY(-{100 * at / count}%)"
    return f"""<figure class="frames" data-told="{told}" style="max-width: {width}px; --frames-width: {width}px">
<div class="frames-box"><div class="frames-window" style="aspect-ratio: {width} / {height}">
<img src="_static/frames/{strip["file"]}" alt="{alt}" style="{moved}">
</div></div>
<figcaption><button type="button" class="frames-play" aria-label="play">&#9654;</button>
<label><span>{label}: <b></b></span><input type="range" min="0" max="{count - 1}" value="{at}"></label>
<table class="frames-said"><tbody></tbody></table></figcaption></figure>"""


def as_plain_text(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are prose and not reStructuredText: |v_d| is a size and *shape an unpacking."""
    example = False
    for number, line in enumerate(lines):
        example = line.lstrip().startswith(">>>") or (example and bool(line.strip()))  # to the next empty line
        if example:
            continue
        bullet, text = re.match(r"(\s*(?:\* |:returns: )?)(.*)", line).groups()
        if ":returns:" in bullet:
            text = text.removeprefix("*").removesuffix("*")  # a type, which napoleon sets in italics
        pieces = text.split("`")  # what stands between backticks is code
        pieces[::2] = [re.sub(r"(?<!\\)([*|])", r"\\\1", piece) for piece in pieces[::2]]
        lines[number] = bullet + "`".join(pieces)


def with_links(app: Any, doctree: Any) -> None:
    """Chapters and numbered formulas that the text mentions link themselves, but for those of the page itself."""
    from docutils import nodes  # Sphinx brings it; tests read this file without

    docname, unlinked = app.env.docname, tuple(getattr(nodes, name) for name in UNLINKED)
    if docname == "site/reading":  # the chapters of books
        return
    for text in list(doctree.findall(nodes.Text)):
        above, node = [], text
        while node := node.parent:
            above.append(node)
        if any(isinstance(parent, unlinked) for parent in above):
            continue
        pieces: list[Any] = []
        for part in MENTIONED.split(text.astext()):
            mentioned = MENTIONED.fullmatch(part)
            for piece in ONE.split(part) if mentioned else [part]:
                place = where(piece) if mentioned and ONE.fullmatch(piece) else None
                if place is None or (place[0] == docname and not place[1]):
                    pieces.append(nodes.Text(piece))
                else:
                    address = f"{app.builder.get_relative_uri(docname, place[0])}{place[1]}"
                    pieces.append(nodes.reference("", piece, refuri=address, internal=True))
        if any(isinstance(piece, nodes.reference) for piece in pieces):
            text.parent.replace(text, pieces)


def where(mention: str) -> tuple[str, str] | None:
    """The page and the place in it of what is mentioned: "chapter 7", "8" after it, or "(7.3)"."""
    if mention.startswith("("):
        return (TAGS[mention[1:-1]], f"#{formula_name(mention[1:-1])}") if mention[1:-1] in TAGS else None
    chapter = CHAPTERS.get(int(mention.split()[-1]))
    return chapter and (chapter.stem, "")


def formula_name(tag: str) -> str:
    """What the place of a numbered formula is called in addresses."""
    return f"formula-{tag.replace('.', '-').replace(chr(39), 'a')}"


def as_written(app: Any, doctree: Any) -> None:
    """Displayed formulas as they stand: Sphinx would wrap rows into an environment in which no tag is allowed."""
    from docutils import nodes

    for formula in doctree.findall(nodes.math_block):
        formula["ids"] += [formula_name(tag) for tag in TAG.findall(formula.astext())]
        formula["no-wrap"] = True
        formula.children = [nodes.Text(rf"\[{formula.astext()}\]")]


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", as_plain_text, priority=900)  # after numpydoc's sections are understood
    app.connect("doctree-read", as_written)
    app.connect("doctree-read", with_links)
    app.connect("source-read", as_page)
    app.connect("source-read", with_directives)
    return {"parallel_read_safe": True}

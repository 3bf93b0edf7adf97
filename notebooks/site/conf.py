"""Sphinx: the course as a site, from the executed notebooks; nothing is run.

pip install -e '.[docs]'
python -m sphinx -c notebooks/site notebooks build/site
"""

import json
import os
import re
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
mathjax3_config = {"options": {"enableMenu": False}}
suppress_warnings = ["myst.header", "mystnb.unknown_mime_type"]

autodoc_member_order = "bysource"
autodoc_typehints = "none"
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "pydata_sphinx_theme"
html_title = "sdhj: a course"
html_static_path = ["_static"]
html_css_files = ["wide.css"]
html_sidebars = {"**": ["globaltoc.html"]}
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_center": [],  # the chapters stand at the left
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "search_bar_text": "Search",
    "pygments_light_style": "tango",
}


def with_alt_texts(app: Any, docname: str, source: list[str]) -> None:
    """Give a notebook's pictures the words that their outputs carry, where MyST-NB looks for them."""
    if not os.fspath(app.env.doc2path(docname)).endswith(".ipynb"):
        return
    notebook = json.loads(source[0])
    for cell in notebook["cells"]:
        told = (output.get("metadata", {}).get("image/png", {}).get("alt") for output in cell.get("outputs", []))
        if words := next(filter(None, told), None):
            cell["metadata"].setdefault("mystnb", {})["image"] = {"alt": words}
    source[0] = json.dumps(notebook)


def as_plain_text(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Docstrings are prose and not reStructuredText: |v_d| is a size and *shape an unpacking."""
    for number, line in enumerate(lines):
        bullet, text = re.match(r"(\s*(?:\* )?)(.*)", line).groups()
        pieces = text.split("`")  # what stands between backticks is code
        pieces[::2] = [re.sub(r"(?<!\\)([*|])", r"\\\1", piece) for piece in pieces[::2]]
        lines[number] = bullet + "`".join(pieces)


def as_written(app: Any, doctree: Any) -> None:
    """Displayed formulas as they stand: Sphinx would wrap rows into an environment in which no tag is allowed."""
    from docutils import nodes  # only Sphinx needs it

    for formula in doctree.findall(nodes.math_block):
        formula["no-wrap"] = True
        formula.children = [nodes.Text(rf"\[{formula.astext()}\]")]


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("autodoc-process-docstring", as_plain_text, priority=900)  # after numpydoc's sections are understood
    app.connect("doctree-read", as_written)
    app.connect("source-read", with_alt_texts)
    return {"parallel_read_safe": True}

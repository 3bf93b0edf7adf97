"""Sphinx: the course as a site, from the executed notebooks; nothing is run.

    pip install -e '.[docs]'
    python -m sphinx -c notebooks/site notebooks build/site
"""

import json
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
nitpicky = True
nitpick_ignore_regex = [("py:.*", r".*")]  # names in docstrings' types; links in the text are checked

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
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_align": "left",
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "search_bar_text": "Search",
    "pygments_light_style": "tango",
}


def with_alt_texts(app: Any, docname: str, source: list[str]) -> None:
    """Give a notebook's pictures the words that their outputs carry, where MyST-NB looks for them."""
    if not app.env.doc2path(docname).endswith(".ipynb"):
        return
    notebook = json.loads(source[0])
    for cell in notebook["cells"]:
        told = (output.get("metadata", {}).get("image/png", {}).get("alt") for output in cell.get("outputs", []))
        if words := next(filter(None, told), None):
            cell["metadata"].setdefault("mystnb", {})["image"] = {"alt": words}
    source[0] = json.dumps(notebook)


def setup(app: Any) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("source-read", with_alt_texts)
    return {"parallel_read_safe": True}

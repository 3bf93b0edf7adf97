"""The course as a site: built without a warning, without dead links, and read in a real browser without a network.

Skipped without what `pip install -e '.[docs]'` brings; the browser's part also without Chromium or Playwright.
"""

import builtins
import importlib
import inspect
import json
import pydoc
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from functools import cache, partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest
from browsing import chromium

import sdhj

ROOT = Path(__file__).parent.parent.parent
NEEDED = ("sphinx", "myst_nb", "pydata_sphinx_theme", "sphinx-mathjax-offline")
RAW = re.compile(r"\\(?:[a-zA-Z]{2,}|[()\[\]])|\$[^\s$][^$]*\$")  # \frac, \(, $x$: LaTeX that nobody has set
SETTLED = "() => !window.MathJax || (window.MathJax.startup && window.MathJax.startup.promise.then(() => true))"
# what a reader sees, less code and what it printed
TEXT = """() => {
    const seen = document.querySelector('main').cloneNode(true);
    seen.querySelectorAll('pre, code, script, style, mjx-assistive-mml, .output, .sig').forEach(node => node.remove());
    return seen.textContent;
}"""
BROKEN = "() => [...document.images].filter(image => image.complete && !image.naturalWidth).map(image => image.src)"
CELLS = "rows => rows.map(row => [...row.cells].map(cell => cell.innerText))"
WIDTHS = (390, 1280, 1920)  # px: a telephone, a notebook, a screen
# Formulas of which a glyph cannot be seen, however one scrolls: what clips it cuts it off, and does not scroll there.
CUT = """() => {
    document.querySelectorAll('details').forEach(folded => { folded.open = true; });
    const slack = 1;  // px: boxes are rounded to whole pixels
    const sides = {x: ['left', 'right', 'Left', 'Width'], y: ['top', 'bottom', 'Top', 'Height']};
    const reached = (box, parent, [low, high, name, size], overflow) => {
        const frame = parent.getBoundingClientRect(), start = frame[low] + parent['client' + name];
        const scrolls = overflow === 'auto' || overflow === 'scroll';
        const first = start - (scrolls ? parent['scroll' + name] : 0);
        const length = scrolls ? parent['scroll' + size] : parent['client' + size];
        return box[low] >= first - slack && box[high] <= first + length + slack;
    };
    const seen = glyph => {
        let box = {x: glyph.getBoundingClientRect(), y: glyph.getBoundingClientRect()};
        for (let parent = glyph.parentElement; parent !== document.documentElement; parent = parent.parentElement) {
            const style = getComputedStyle(parent);
            if (style.display === 'inline' || parent.tagName === 'BODY') continue;
            for (const [axis, overflow] of [['x', style.overflowX], ['y', style.overflowY]]) {
                if (overflow === 'visible') continue;
                if (!reached(box[axis], parent, sides[axis], overflow)) return false;
                if (overflow === 'auto' || overflow === 'scroll') box[axis] = parent.getBoundingClientRect();
            }
        }
        return box.x.left >= -slack && box.x.right <= document.documentElement.clientWidth + slack;
    };
    const cut = [];
    for (const formula of document.querySelectorAll('main mjx-container')) {
        // MathJax makes the middle of a tall bracket by cutting off a stretched glyph: its ends are looked at
        if (![...formula.querySelectorAll('mjx-c')].filter(glyph => !glyph.closest('mjx-ext')).every(seen)) {
            const words = formula.querySelector('mjx-assistive-mml')?.textContent ?? '';
            cut.push([formula.hasAttribute('display') ? 'displayed' : 'inline', words.slice(0, 60)]);
        }
    }
    return cut;
}"""
# What is wider than where it stands, the page itself among it, but for what scrolls in a box.
TOO_WIDE = """() => [...document.querySelectorAll('html, body *')].filter(node => {
    const style = getComputedStyle(node);
    const clips = node.tagName === 'HTML' || !['visible', 'clip'].includes(style.overflowX);
    const boxes = 'pre, .math, mjx-container, .pst-scrollable-table-container, .indextable, .scrolls, .frames-box';
    const may = node.closest(boxes);
    return clips && !may && style.textOverflow !== 'ellipsis' && node.scrollWidth > node.clientWidth + 1;
}).map(node => `${node.tagName}.${node.className}`)"""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not all(map(find_spec, NEEDED)), reason="needs the extra `docs`"),
]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, built as CONTRIBUTING says; warnings are errors."""
    built = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-c", "notebooks/site", "notebooks", built]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr[-3000:]
    return built


@cache
def read(page: Path) -> Any:
    """A page, parsed by what the theme brings."""
    return importlib.import_module("bs4").BeautifulSoup(page.read_text("utf-8"), "html.parser")


def targets(page: Path) -> list[str]:
    """Where a page points to."""
    return [tag.get("href") or tag.get("src") for tag in read(page).select("[href], [src]")]


def pages(site: Path) -> list[Path]:
    return [path for path in sorted(site.rglob("*.html")) if "_static" not in path.parts]


def test_every_chapter_is_in_the_site_with_its_notebook(site: Path) -> None:
    contents = targets(site / "index.html")
    for chapter in sorted((ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb")):
        page = site / f"{chapter.stem}.html"
        assert page.name in contents
        (file,) = (page.parent / unquote(to) for to in targets(page) if to.endswith(f"/{chapter.name}"))
        assert file.read_bytes() == chapter.read_bytes()


def test_no_link_leads_nowhere(site: Path) -> None:
    names = {
        page.resolve(): {tag[key] for key in ("id", "name") for tag in read(page).select(f"[{key}]")}
        for page in pages(site)
    }
    dead = []
    for page in pages(site):
        for target in targets(page):
            split = urlsplit(target)
            if split.scheme or split.netloc:
                assert split.scheme in ("http", "https", "data", "mailto"), f"{page.name}: {target}"
                continue
            to = (page.parent / unquote(split.path)).resolve() if split.path else page.resolve()
            there = to.is_file() and (to not in names or not split.fragment or unquote(split.fragment) in names[to])
            dead += [] if there else [f"{page.name}: {target}"]
        assert all(image.get("alt") for image in read(page).select("img")), f"{page.name} has a picture without words"
    assert dead == []


EXCEPTIONS = {*dir(builtins), *sdhj.__all__}


def entries(site: Path) -> Iterator[tuple[str, Any]]:
    """Of every page the objects that it describes: the name of each, and its entry."""
    for path in pages(site):
        for entry in read(path).select("dl.py > dt[id]"):
            yield entry["id"], entry.parent


def test_each_parameter_shown_is_one(site: Path) -> None:
    """Prose below parameters would be read as their names; of an exception, or an attribute, as well."""
    seen, wrong = 0, []
    for name, entry in entries(site):
        (owner, _, attribute), described = name.rpartition("."), pydoc.locate(name)
        if described is None:  # a field, or what __init__ sets
            source = inspect.getsource(pydoc.locate(owner))
            wrong += [] if re.search(rf"(?m)^    {attribute}: |self\.{attribute}\b.* = ", source) else [name]
        for title in entry.select(":scope > dd > dl.field-list > dt"):
            names = {strong.text for strong in title.find_next_sibling("dd").select("strong")} - {", "}
            right = inspect.signature(described).parameters if "Parameters" in title.text else EXCEPTIONS
            wrong += [f"{name}: {title.text} {other}" for other in names.difference(right)]
            seen += len(names)
    assert wrong == [] and seen > 0


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """A folder on a free port of this machine; its address."""

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()


@pytest.fixture(scope="module")
def reader(site: Path) -> Iterator[tuple[Any, str]]:
    """A page of a browser that reaches this machine only, and the address of the site."""
    with served(site) as address, chromium() as page:
        page.route("**/*", lambda route: route.continue_() if route.request.url.startswith(address) else route.abort())
        yield page, address


@pytest.mark.browser
def test_every_page_is_whole_and_fits_every_screen_without_the_network(site: Path, reader: tuple[Any, str]) -> None:
    """No error, nothing missing, formulas set and no glyph cut off, no raw LaTeX; on a telephone nothing too wide."""
    page, address = reader
    asked, wrong = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("response", lambda response: response.ok or wrong.append(f"{response.status} {response.url}"))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    formulas = 0
    for path in pages(site):
        page.goto(f"{address}/{path.relative_to(site)}", wait_until="load")
        page.wait_for_function(SETTLED)
        formulas += page.locator("mjx-container").count()
        assert page.locator("mjx-merror").count() == 0, f"{path.name} has a formula that cannot be set"
        assert page.evaluate(BROKEN) == [], f"{path.name} lacks pictures"
        if "_modules" in path.parts:
            continue
        if path.name not in ("search.html", "genindex.html", "py-modindex.html"):
            assert RAW.findall(page.evaluate(TEXT)) == [], f"{path.name} shows LaTeX"
        for width in WIDTHS:
            page.set_viewport_size({"width": width, "height": 1600})
            page.wait_for_timeout(30)
            wrong += [f"{path.name}, {width}: {formula}" for formula in page.evaluate(CUT)]
            wrong += [f"{path.name}: {node}" for node in page.evaluate(TOO_WIDE) if width == WIDTHS[0]]
    assert wrong == [] and formulas > 0
    assert [url for url in asked if not url.startswith((address, "data:"))] == []
    page.set_viewport_size({"width": WIDTHS[0], "height": 1600})
    glyphs = "".join("<mjx-c style='display: inline-block; width: 300px; flex: none'>x</mjx-c>" for _ in range(3))
    page.set_content(f"<main><mjx-container display='true' style='display: flex'>{glyphs}</mjx-container></main>")
    assert page.evaluate(CUT) and page.evaluate(TOO_WIDE)  # beyond the page's right end


@pytest.mark.browser
def test_widgets_move_on_the_site(site: Path, reader: tuple[Any, str]) -> None:
    """Every chapter has a slider; at each of its places another picture stands, and the words that belong to it."""
    page, address = reader
    for chapter in sorted((ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb")):
        told = site / "_static" / "frames" / f"{chapter.stem}.json"
        widgets = json.loads(told.read_text(encoding="utf-8"))["widgets"]
        page.goto(f"{address}/{told.stem}.html", wait_until="load")
        figures = page.locator("figure.frames")
        assert figures.count() == len(widgets) > 0
        for place, widget in enumerate(widgets):
            figure, seen, last = figures.nth(place), set(), len(widget["values"]) - 1
            figure.scroll_into_view_if_needed()
            slider = figure.locator("input")
            assert slider.input_value() == str(widget["values"].index(widget["at"]))
            for number, (value, said) in enumerate(zip(widget["values"], widget["said"], strict=True)):
                slider.fill(str(number))
                assert figure.locator("b").inner_text() == value
                rows = figure.locator("tr").evaluate_all(CELLS)
                assert "; ".join(map(": ".join, rows)) == said
                if number in (0, last // 3, 2 * last // 3):
                    seen.add(figure.locator(".frames-window").screenshot())
            assert len(seen) == 3, f"{widget['file']} hardly moves"
        assert "Controls, live" not in page.locator("main").inner_text()


@pytest.mark.browser
def test_a_loop_plays_until_a_reader_takes_it_and_not_for_those_who_ask_for_none(reader: tuple[Any, str]) -> None:
    page, address = reader
    for wanted, moves in (("no-preference", True), ("reduce", False)):
        page.emulate_media(reduced_motion=wanted)
        page.goto(f"{address}/11_controller.html", wait_until="load")
        figures = page.locator("figure.frames").all()
        figure = next(one for one in figures if json.loads(one.get_attribute("data-told"))["loop"])
        figure.scroll_into_view_if_needed()
        slider = figure.locator("input")
        first = slider.input_value()
        page.wait_for_timeout(1500)
        assert (slider.input_value() != first) is moves
        slider.fill("2")
        page.wait_for_timeout(800)
        assert slider.input_value() == "2"
        figure.locator("button").click()  # which plays it for anybody
        page.wait_for_timeout(800)
        assert slider.input_value() != "2"


@pytest.mark.browser
def test_code_is_copied_wide_pictures_scroll_and_tables_are_lists_on_a_telephone(reader: tuple[Any, str]) -> None:
    page, address = reader
    page.context.grant_permissions(["clipboard-read", "clipboard-write"], origin=address)
    page.goto(f"{address}/site/maps.html", wait_until="load")
    code = page.locator("main div.highlight").first
    code.locator("button.copy").click()
    assert page.evaluate("() => navigator.clipboard.readText()") == code.locator("pre").inner_text()
    page.set_viewport_size({"width": WIDTHS[0], "height": 1600})
    page.goto(f"{address}/index.html", wait_until="load")
    assert page.locator(".scrolls").first.evaluate("box => box.scrollWidth > box.clientWidth")
    row = page.locator("table.listed tbody tr").first
    tops = [cell.bounding_box()["y"] for cell in row.locator("td").all()]
    assert len(tops) > 1 and tops == sorted(set(tops))  # one below the other, each with its column's name
    cell = page.locator("table.listed td[data-head=question]").first
    assert "question" in cell.evaluate("cell => getComputedStyle(cell, '::before').content")


def test_mentions_of_chapters_and_formulas_are_links(site: Path) -> None:
    """But for those on the page itself: chapters without a link are its own, and numbers of formulas all have one."""
    for path in sorted(site.glob("[0-9][0-9]_*.html")):
        article = copy(read(path).select_one("article"))
        for part in article.select("pre, code, h1, h2, h3, .math, .output, figure, details"):
            part.decompose()
        links = [link.extract().text for link in article.select("a")]
        assert any(re.search(r"[Cc]hapter|\(\d+\.\d+'?\)", link) for link in links), path.name
        left = {int(number) for number in re.findall(r"[Cc]hapters? (\d+)", article.text)}
        assert left <= {int(path.name[:2])}, path.name
        assert not re.findall(r"\((?:1[0-7]|[1-9])\.\d{1,2}'?\)", article.text), path.name

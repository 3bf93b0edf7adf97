"""The course as a site: built without a warning, without dead links, and read in a real browser without a network.

Skipped without what `pip install -e '.[docs]'` brings; the browser's part also without Chromium or Playwright.
"""

import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest

ROOT = Path(__file__).parent.parent.parent
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-dev-shm-usage"]
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


class Links(HTMLParser):
    """Where a page points to, and the names that others can point to in it."""

    def __init__(self, page: Path) -> None:
        super().__init__()
        self.targets: list[str] = []
        self.names: set[str] = set()
        self.unnamed_pictures: list[str] = []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.names |= {given[name] for name in ("id", "name") if given.get(name)}
        self.targets += [given[name] for name in ("href", "src") if given.get(name)]
        if tag == "img" and not given.get("alt"):
            self.unnamed_pictures.append(given.get("src", ""))


def pages(site: Path) -> list[Path]:
    return [path for path in sorted(site.rglob("*.html")) if "_static" not in path.parts]


def test_every_chapter_is_in_the_site(site: Path) -> None:
    chapters = sorted(path.stem for path in (ROOT / "notebooks").glob("[0-9][0-9]_*.ipynb"))
    assert len(chapters) >= 14
    contents = (site / "index.html").read_text(encoding="utf-8")
    for chapter in chapters:
        assert (site / f"{chapter}.html").is_file() and f'href="{chapter}.html"' in contents
    for page in ("notation", "reading", "syllabus", "solutions", "worked", "promises", "api", "contributing"):
        assert (site / "site" / f"{page}.html").is_file()
    assert "sdhj.solve" in (site / "site" / "api.html").read_text(encoding="utf-8")


def test_no_link_leads_nowhere(site: Path) -> None:
    read = {path.resolve(): Links(path) for path in pages(site)}
    dead = []
    for path, links in read.items():
        for target in links.targets:
            split = urlsplit(target)
            if split.scheme or split.netloc:
                assert split.scheme in ("http", "https", "data", "mailto"), f"{path.name}: {target}"
                continue
            to = (path.parent / unquote(split.path)).resolve() if split.path else path
            known = read[to].names if to in read else None
            if not to.is_file() or (
                split.fragment and known is not None and unquote(split.fragment) not in known | {""}
            ):
                dead.append(f"{path.name}: {target}")
    assert dead == []
    assert [picture for links in read.values() for picture in links.unnamed_pictures] == []


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


@contextmanager
def chromium() -> Iterator[Any]:
    """A page of a headless Chromium; skips where there is none."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on the path: install chromium to run the browser test")
    sync = pytest.importorskip("playwright.sync_api", reason="needs Playwright: pip install playwright")
    with sync.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, headless=True, args=FLAGS)
        try:
            yield browser.new_page(viewport={"width": 1280, "height": 1600})
        finally:
            browser.close()


@pytest.mark.browser
def test_mathematics_is_set_without_the_network(site: Path) -> None:
    """Every page in a browser that reaches this machine only: no error, nothing missing, formulas set, no raw LaTeX."""
    with served(site) as address, chromium() as page:
        asked, wrong = [], []
        page.route("**/*", lambda route: route.continue_() if route.request.url.startswith(address) else route.abort())
        page.on("request", lambda request: asked.append(request.url))
        page.on("response", lambda response: response.ok or wrong.append(f"{response.status} {response.url}"))
        page.on("pageerror", lambda error: wrong.append(str(error)))
        formulas = 0
        for path in pages(site):
            page.goto(f"{address}/{path.relative_to(site)}", wait_until="load")
            page.wait_for_function(SETTLED)
            page.wait_for_timeout(50)
            formulas += page.locator("mjx-container").count()
            assert page.locator("mjx-merror").count() == 0, f"{path.name} has a formula that cannot be set"
            broken = page.evaluate(
                "() => [...document.images].filter(i => i.complete && !i.naturalWidth).map(i => i.src)"
            )
            assert broken == [], f"{path.name} lacks pictures"
            if "_modules" not in path.parts and path.name not in ("search.html", "genindex.html", "py-modindex.html"):
                assert RAW.findall(page.evaluate(TEXT)) == [], f"{path.name} shows LaTeX"
        assert formulas > 500
        assert wrong == []
        assert [url for url in asked if not url.startswith((address, "data:"))] == []

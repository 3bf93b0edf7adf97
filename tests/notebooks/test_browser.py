"""Chapters in a real browser: JupyterLab on a free port of this machine, a headless Chromium, controls moved by key.

Each chapter becomes a notebook of its widgets and of what they need, nothing more, and every control of every widget
goes to both ends. A picture's words end with what it says, so that what the browser shows can be compared to the
numbers below the controls.
"""

import ast
import json
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import nbformat
import pytest
from browsing import chromium

ROOT = Path(__file__).parent.parent.parent
CHAPTERS = sorted((ROOT / "notebooks").glob("[0-9]*.ipynb"))
START = 120  # s for the server to answer
PATIENCE = 600  # s for a chapter to run: one that waits for compiled code on a busy machine
ANSWER = 120  # s for a widget to answer: one that solves, on a busy machine

pytestmark = [pytest.mark.browser, pytest.mark.slow]

CELLS = "window.jupyterapp.shell.currentWidget.content.widgets.filter(cell => cell.model.type === 'code')"
HAS_KERNEL = "window.jupyterapp?.shell.currentWidget?.sessionContext?.session?.kernel?.status === 'idle'"
OUTPUTS = f"{CELLS}.map(cell => cell.model.sharedModel.getOutputs())"
FAILED = f"{OUTPUTS}.flat().some(output => output.output_type === 'error')"  # the cells below do not run
ENDED = f"({CELLS}.every(cell => cell.model.executionCount > 0) || {FAILED}) && {HAS_KERNEL}"
WIDGET = "application/vnd.jupyter.widget-view+json"
GREYED = "(control) => control.closest('[disabled]') !== null"


# ---- server and browser


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def jupyterlab(folder: Path, state: Path) -> Iterator[str]:
    """JupyterLab over `folder`, its settings in `state` and not in the user's home; its address."""
    quiet = state / "config" / "labconfig"
    quiet.mkdir(parents=True)
    disabled = {"@jupyterlab/apputils-extension:announcements": True}  # asks a question in a corner
    (quiet / "page_config.json").write_text(json.dumps({"disabledExtensions": disabled}))
    port = free_port()
    options = ["--no-browser", "--allow-root", "--ServerApp.ip=127.0.0.1", f"--ServerApp.port={port}"]
    options += ["--ServerApp.port_retries=0", "--IdentityProvider.token=", "--LabApp.expose_app_in_browser=True"]
    environment = os.environ | {
        "JUPYTER_CONFIG_DIR": str(state / "config"),
        "JUPYTERLAB_SETTINGS_DIR": str(state / "settings"),
        "JUPYTERLAB_WORKSPACES_DIR": str(state / "workspaces"),
        "JUPYTER_RUNTIME_DIR": str(state / "runtime"),
        "IPYTHONDIR": str(state / "ipython"),
        "PYTHONPATH": os.pathsep.join(filter(None, (str(ROOT), str(ROOT / "notebooks"), os.environ.get("PYTHONPATH")))),
    }
    with (state / "server.log").open("w") as log:
        command = [sys.executable, "-m", "jupyterlab", *options, f"--ServerApp.root_dir={folder}"]
        server = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
    address = f"http://127.0.0.1:{port}"
    try:
        wait_for(f"{address}/api/status", server, state / "server.log")
        yield address
    finally:
        server.terminate()
        try:
            server.wait(60)  # it ends the kernels of all chapters first
        except subprocess.TimeoutExpired:
            server.kill()
            server.wait()


def wait_for(url: str, server: subprocess.Popen[bytes], log: Path) -> None:
    """Until the server answers; fails with its log where it does not."""
    until = time.monotonic() + START
    while time.monotonic() < until and server.poll() is None:
        try:
            urllib.request.urlopen(url, timeout=5)
            return
        except (urllib.error.URLError, OSError):
            time.sleep(0.3)
    pytest.fail(f"JupyterLab does not answer:\n{log.read_text()[-2000:]}")


def run_chapter(page: Any, address: str, name: str) -> None:
    """Open a notebook and run all its cells from the menu."""
    page.goto(f"{address}/lab/tree/{name}?reset", wait_until="domcontentloaded")
    page.wait_for_function(HAS_KERNEL, timeout=START * 1000)
    page.get_by_role("menuitem", name="Run", exact=True).click()
    page.get_by_role("menuitem", name="Run All Cells", exact=True).click()
    page.wait_for_function(f"{CELLS}.every(cell => !cell.model.executionCount) || !({HAS_KERNEL})")  # it has begun
    page.wait_for_function(ENDED, timeout=PATIENCE * 1000)


def errors(page: Any) -> list[Any]:
    """Error outputs and what was written to standard error, in all cells."""
    outputs = [output for cell in page.evaluate(OUTPUTS) for output in cell]
    return [o for o in outputs if o["output_type"] == "error" or o.get("name") == "stderr"]


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, str, Path]]:
    """A page, the address of JupyterLab, and the folder of its notebooks."""
    folder = tmp_path_factory.mktemp("lab")
    (folder / "notebooks").mkdir()
    with chromium() as page, jupyterlab(folder / "notebooks", folder) as address:
        yield page, address, folder / "notebooks"


@pytest.fixture(scope="module")
def opened(lab: tuple[Any, str, Path]) -> Any:
    """A function that writes a notebook of some cells, runs it in the browser, and returns the page."""
    page, address, folder = lab

    def run(cells: list[str], name: str) -> Any:
        notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
        notebook.metadata.kernelspec = {"display_name": "Python 3", "language": "python", "name": "python3"}
        nbformat.write(notebook, folder / f"{name}.ipynb")
        run_chapter(page, address, f"{name}.ipynb")
        assert errors(page) == []
        return page

    return run


# ---- what a chapter's widgets need


def is_widget(statement: ast.stmt) -> bool:
    """A call of explore_something(...) on a line of its own."""
    call = statement.value if isinstance(statement, ast.Expr) else None
    return isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id.startswith("explore_")


def widget_cells(path: Path) -> list[str]:
    """The widgets of a chapter, each at the end of a cell with what is defined before it, less what is only shown."""
    code = [cell.source for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]
    cells: list[list[str]] = [[]]
    for statement in (statement for cell in code for statement in ast.parse(cell).body):
        if is_widget(statement) or not isinstance(statement, ast.Expr):
            cells[-1].append(ast.unparse(statement))
        if is_widget(statement):
            cells.append([])
    return ["\n".join(cell) for cell in cells[:-1]]


# ---- a widget, as somebody at the screen sees and moves it


class Seen:
    """A widget in the browser, by the place of its cell."""

    def __init__(self, page: Any, place: int) -> None:
        self.page, self.place, self.cell = page, place, page.locator(".jp-CodeCell").nth(place)
        self.cell.scroll_into_view_if_needed()
        self.picture = self.cell.locator(".jp-RenderedHTML img")
        self.picture.wait_for()

    @property
    def status(self) -> str:
        """What stands below the controls."""
        told = self.cell.locator(".widget-html").last.locator("[role=status], [role=alert]")
        text: str = told.last.inner_text().strip()
        return text

    @property
    def said(self) -> str:
        """The words of the picture, which say what it shows."""
        text: str = self.picture.get_attribute("alt")
        return text

    @property
    def refused(self) -> bool:
        return self.cell.locator("[role=alert]").count() > 0

    def settle(self) -> None:
        """Wait for the answer: the kernel has come to rest and picture and numbers agree, or it says why not."""
        until, quiet = time.monotonic() + ANSWER, 0
        while time.monotonic() < until:
            answered = self.page.evaluate(HAS_KERNEL) and (self.refused or self.said.endswith(self.status))
            quiet = quiet + 1 if answered else 0
            if quiet == 3:
                return
            self.page.wait_for_timeout(60)
        pytest.fail(f"the picture says {self.said!r} and the numbers {self.status!r}")

    def controls(self, kind: str) -> list[Any]:
        """The controls of a kind that can be moved: ".noUi-handle", "select", "input[type=number]"."""
        return [one for one in self.cell.locator(kind).all() if one.is_visible() and not one.evaluate(GREYED)]

    @property
    def shown_first(self) -> str:
        """What a page without a kernel says that the picture shows: the first setting, before the browser had it."""
        outputs = self.page.evaluate(OUTPUTS)[self.place]
        (told,) = (o["data"]["text/plain"] for o in outputs if WIDGET in o.get("data", {}))
        return str("".join(told)).partition("Shown: ")[2]

    def press(self, control: Any, key: str) -> None:
        """Press a key on a slider's handle and wait for the answer."""
        control.press(key)
        self.page.wait_for_timeout(30)
        self.settle()

    def visit(self) -> Iterator[str]:
        """Move each control on its own to both ends and back; a word for each stop."""
        for place, handle in enumerate(self.controls(".noUi-handle")):
            before = float(handle.get_attribute("aria-valuenow"))
            for key, end in (("End", "aria-valuemax"), ("Home", "aria-valuemin")):
                self.press(handle, key)
                assert float(handle.get_attribute("aria-valuenow")) == float(handle.get_attribute(end))
                yield f"slider {place} at its {key.lower()}"
            slider = handle.locator("xpath=ancestor::*[contains(@class,'widget-slider')]")
            readout = slider.locator(".widget-readout")
            if readout.is_visible():
                readout.fill(str(before))
                readout.press("Enter")
                self.settle()
            player = slider.locator("xpath=../*[contains(@class,'widget-play')]")
            if player.count():
                begun, button = handle.get_attribute("aria-valuenow"), player.locator("button").first
                button.click()
                self.page.wait_for_timeout(1500)
                button.click()
                self.settle()
                assert handle.get_attribute("aria-valuenow") != begun
                yield f"slider {place} after playing"
        for place, box in enumerate(self.controls("input[type=number]")):
            for end in ("min", "max"):
                box.fill(box.get_attribute(end))
                box.press("Enter")
                self.settle()
                yield f"box {place} at its {end}"
            box.fill("0.5")
            box.press("Enter")
            self.settle()
        for place, chooser in enumerate(self.controls("select")):
            options = [option.inner_text() for option in chooser.locator("option").all()]
            before = chooser.input_value()
            for option in options:
                chooser.select_option(label=option)
                self.settle()
                yield f"list {place} at {option!r}"
            chooser.select_option(before)
            self.settle()


def test_words_of_pictures_reach_who_only_opens_a_chapter(lab: tuple[Any, str, Path]) -> None:
    """Nobody has run it here, so that JupyterLab does not trust it and takes away from its HTML what could do harm."""
    page, address, folder = lab
    shutil.copy(CHAPTERS[0], folder / "stored.ipynb")
    page.goto(f"{address}/lab/tree/stored.ipynb?reset", wait_until="domcontentloaded")
    image = page.locator(".jp-OutputArea-output img").first
    image.wait_for()
    words = image.get_attribute("alt")
    assert words and f'alt="{words}"' in json.dumps(nbformat.read(CHAPTERS[0], 4).cells).replace('\\"', '"')
    assert image.evaluate("(image) => image.naturalWidth > 300 && image.clientWidth > 300")


# ---- every widget of every chapter


@pytest.fixture(scope="module", params=CHAPTERS, ids=lambda path: path.stem)
def chapter(request: pytest.FixtureRequest, opened: Any) -> Iterator[tuple[Any, list[str]]]:
    """The page with a chapter's widgets, each in a cell of its own, and their calls."""
    cells = widget_cells(request.param)
    if not cells:
        pytest.skip("no widget in this chapter")
    page = opened(cells, request.param.stem)
    yield page, [cell.splitlines()[-1] for cell in cells]
    page.evaluate("window.jupyterapp.shell.currentWidget.sessionContext.shutdown()")  # and its tables


def test_every_control_goes_to_both_ends(chapter: tuple[Any, list[str]]) -> None:
    page, calls = chapter
    for place, call in enumerate(calls):
        seen = Seen(page, place)
        seen.settle()
        assert seen.status == seen.shown_first, f"{call} is another as soon as it is shown"
        pictures, stops = {seen.picture.get_attribute("src")}, 0
        for stop in seen.visit():
            stops += 1
            assert not seen.refused, f"{call}, {stop}: {seen.status}"
            pictures.add(seen.picture.get_attribute("src"))
        assert stops and len(pictures) > 1, f"{call} answers to nothing"
    assert errors(page) == []

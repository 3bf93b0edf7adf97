"""Chapters in a real browser: JupyterLab on a free port of this machine, a headless Chromium, a slider moved by key."""

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

import pytest

ROOT = Path(__file__).parent.parent.parent
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-dev-shm-usage"]
START = 120  # s for the server to answer
PATIENCE = 600  # s for a chapter to run: one that waits for compiled code on a busy machine

pytestmark = [pytest.mark.browser, pytest.mark.slow]

CELLS = "window.jupyterapp.shell.currentWidget.content.widgets.filter(cell => cell.model.type === 'code')"
HAS_KERNEL = "window.jupyterapp?.shell.currentWidget?.sessionContext?.session?.kernel?.status === 'idle'"
ALL_RAN = f"{CELLS}.every(cell => cell.model.executionCount > 0) && {HAS_KERNEL}"
OUTPUTS = f"{CELLS}.map(cell => cell.model.sharedModel.getOutputs())"


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
        server.wait(30)


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


@contextmanager
def chromium(width: int = 1280, height: int = 1600) -> Iterator[Any]:
    """A page of a headless Chromium, light theme; skips where there is none."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on the path: install chromium to run the browser test")
    sync = pytest.importorskip("playwright.sync_api", reason="needs Playwright: pip install playwright")
    with sync.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, headless=True, args=FLAGS)
        page = browser.new_page(viewport={"width": width, "height": height}, color_scheme="light")
        page.set_default_timeout(60_000)
        try:
            yield page
        finally:
            browser.close()


def run_chapter(page: Any, address: str, name: str) -> None:
    """Open a chapter and run all its cells from the menu."""
    page.goto(f"{address}/lab/tree/{name}?reset", wait_until="domcontentloaded")
    page.wait_for_function(HAS_KERNEL, timeout=START * 1000)
    page.get_by_role("menuitem", name="Run", exact=True).click()
    page.get_by_role("menuitem", name="Run All Cells", exact=True).click()
    page.wait_for_function(f"{CELLS}.every(cell => !cell.model.executionCount) || !({HAS_KERNEL})")  # it has begun
    page.wait_for_function(ALL_RAN, timeout=PATIENCE * 1000)


def errors(page: Any) -> list[Any]:
    """Error outputs and what was written to standard error, in all cells."""
    outputs = [output for cell in page.evaluate(OUTPUTS) for output in cell]
    return [o for o in outputs if o["output_type"] == "error" or o.get("name") == "stderr"]


def strip_outputs(source: Path, target: Path) -> None:
    """A chapter as its author left it: what the browser shows is then made in this run."""
    notebook = json.loads(source.read_text(encoding="utf-8"))
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            cell.update(outputs=[], execution_count=None)
    target.write_text(json.dumps(notebook), encoding="utf-8")


@pytest.mark.parametrize("name", ["01_sets_as_functions.ipynb", "03_one_interval.ipynb"])
def test_a_slider_changes_the_picture(name: str, tmp_path: Path) -> None:
    """The first chapter only redraws; in the third a slider solves a game anew."""
    (tmp_path / "notebooks").mkdir()
    strip_outputs(ROOT / "notebooks" / name, tmp_path / "notebooks" / name)
    with chromium() as page, jupyterlab(tmp_path / "notebooks", tmp_path) as address:
        run_chapter(page, address, name)
        assert errors(page) == []
        widget = page.locator(".jp-CodeCell", has=page.locator(".noUi-handle")).first
        widget.scroll_into_view_if_needed()
        image = widget.locator(".jp-RenderedImage img")
        assert image.count() == 1
        before = image.get_attribute("src")
        widget.locator(".noUi-handle").first.press("ArrowRight")
        until = time.monotonic() + 120
        while image.get_attribute("src") == before and time.monotonic() < until:  # the element may be a new one
            page.wait_for_timeout(100)
        assert image.get_attribute("src") != before
        assert errors(page) == []
        size = image.evaluate("image => [image.naturalWidth, image.naturalHeight]")
        assert min(size) > 200

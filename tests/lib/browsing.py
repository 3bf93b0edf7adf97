"""A real browser for the tests of the course: a headless Chromium, driven by Playwright."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-dev-shm-usage"]


@contextmanager
def chromium() -> Iterator[Any]:
    """A page in a light theme, where nothing moves that need not; skips where there is no browser."""
    if CHROMIUM is None:
        pytest.skip("no Chromium on the path: install chromium to run the browser test")
    sync = pytest.importorskip("playwright.sync_api", reason="needs Playwright: pip install playwright")
    with sync.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, headless=True, args=FLAGS)
        size = {"width": 1280, "height": 1600}
        page = browser.new_page(viewport=size, color_scheme="light", reduced_motion="reduce")
        page.set_default_timeout(60_000)
        try:
            yield page
        finally:
            browser.close()

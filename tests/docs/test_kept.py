"""Numbers that pages and chapters quote from commands are those that the commands printed last."""

import json
import re
from collections.abc import Callable

import fig14_timing
import keep
import numpy as np
import pytest
from common import NAMES, PAPER_NODES
from documents import ROOT, column
from PIL import Image

SITE = ROOT / "notebooks" / "site"

QUOTED = keep.marks()


def test_pages_and_pictures_show_what_was_printed_last() -> None:
    assert set(QUOTED) == {path.stem for path in (keep.HERE / "kept").glob("*.txt")}
    for name, command in QUOTED.items():
        assert keep.kept_file(name).read_text("utf-8").splitlines()[0] == f"$ {command}", name
        script = ROOT / command.split()[1]
        assert script.is_file()
        if script.parent.name == "figures" and script.stem in NAMES:
            with Image.open(keep.HERE / "gallery" / f"{script.stem}.png") as image:
                assert image.info["printed"] == keep.digest(name), name
    for page in keep.PAGES:
        text = page.read_text("utf-8")
        assert keep.brought_up(text, QUOTED) == text, page.name


def runs(adversaries: str) -> str:
    played = zip(column("certified", "adversary"), column("certified", "runs"), strict=True)
    return f"{sum(int(count) for adversary, count in played if re.fullmatch(adversaries, adversary)):,}"


CLAIMS: dict[str, tuple[str, Callable[[], str]]] = {
    "runs": (r"A certified table lost none of\s+([\d,]+) runs", lambda: runs("random|aggressive|worst")),
    "search": (r"nor of ([\d,]+) in which a search", lambda: runs("search")),
}


@pytest.mark.parametrize("claim", CLAIMS)
def test_readme_says_in_words_what_was_printed(claim: str) -> None:
    pattern, told = CLAIMS[claim]
    assert re.findall(pattern, (ROOT / "README.md").read_text("utf-8")) == [told()]
    assert all(failed.startswith("0 (") for failed in column("certified", "failed"))


def test_nothing_that_is_certified_was_lost() -> None:
    assert set(column("shaky", "lost", "arm, pursuer | certified |")) == {"0"}
    for robot in ("arm, pursuer", "double integrator", "car", "point in the plane"):
        assert column("shaky", "lost", f"{robot} | certified | ") == ["0"]
        (control,) = column("shaky", "lost", f"{robot} | certified, told nothing")
        assert int(control.replace(",", "")) > 0
    for robot in ("car", "arm", "space"):
        assert column("large", "lost", f"{robot} | certified") == ["none"]


def test_chapter_10_and_its_picture_show_the_timing_that_the_page_shows() -> None:
    measured = fig14_timing.printed(keep.kept("timing"))
    chapter = json.loads((ROOT / "notebooks" / "10_cost.ipynb").read_text("utf-8"))
    said = "".join("".join(out.get("text", "")) for cell in chapter["cells"] for out in cell.get("outputs", []))
    for scheme, by_method in measured.items():
        assert list(by_method["hji"]) == list(PAPER_NODES) == list(by_method["projected"])
        found = re.search(rf"^full / projected, {scheme} +(.*)$", said, re.MULTILINE)
        assert found is not None
        full, projected = (list(by_nodes.values()) for by_nodes in by_method.values())
        np.testing.assert_allclose([*map(float, found[1].split())], np.divide(full, projected), atol=0.006)

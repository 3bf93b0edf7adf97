"""Numbers that pages and chapters quote from commands are those that the commands printed last."""

import re

import keep
from common import NAMES
from documents import ROOT, column
from PIL import Image


def test_pages_and_pictures_show_what_commands_printed_last() -> None:
    """Tables, and what README says of them in words; who knows of what disturbs it loses none of what is certified."""
    quoted = keep.marks()
    assert set(quoted) == {path.stem for path in (keep.HERE / "kept").glob("*.txt")}
    for name, command in quoted.items():
        assert keep.kept_file(name).read_text("utf-8").splitlines()[0] == f"$ {command}", name
        script = ROOT / command.split()[1]
        assert script.is_file()
        if script.parent.name == "figures" and script.stem in NAMES:
            with Image.open(keep.HERE / "gallery" / f"{script.stem}.png") as image:
                assert image.info["printed"] == keep.digest(name), name
    for page in keep.PAGES:
        assert keep.brought_up(page.read_text("utf-8"), quoted) == page.read_text("utf-8"), page.stem
    played = list(zip(column("certified", "adversary"), column("certified", "runs"), strict=True))
    readme = (ROOT / "README.md").read_text("utf-8")
    for said, adversaries in (("lost none of", ("random", "aggressive", "worst")), ("nor of", ("search",))):
        runs = sum(int(count) for adversary, count in played if adversary in adversaries)
        assert re.search(rf"{said}\s+{runs:,}\s", readme), f"{said} {runs:,}"
    assert all(failed.startswith("0 (") for failed in column("certified", "failed"))
    assert set(column("shaky", "lost", "arm, pursuer | certified |")) == {"0"}

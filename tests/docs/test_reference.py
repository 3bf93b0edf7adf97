"""The reference: a page for each class; what is on it can be used by a reader who sees nothing else."""

import inspect
import pydoc
import re
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import pytest
from documents import ROOT

import sdhj
from sdhj import plotting

SITE = ROOT / "notebooks" / "site"
PAGES = [SITE / "api.md", *sorted((SITE / "api").glob("*.md"))]


def listed() -> Iterator[tuple[str, str]]:
    """What the reference names: the kind of each entry, and its name."""
    for page in PAGES:
        owner = ""
        for line in page.read_text("utf-8").splitlines():
            if entry := re.match(r"\.\. auto(class|function|method|exception):: (\S+)", line):
                owner = entry[2]
                yield entry[1], owner
            elif members := re.match(r"   :members: (.+)", line):
                yield from (("member", f"{owner}.{name.strip()}") for name in members[1].split(","))


LISTED = [entry for entry in listed() if find_spec("gymnasium") or "environment" not in entry[1]]


def object_of(name: str) -> Any:
    found = pydoc.locate(name)
    assert found is not None, name
    return found


def test_all_that_users_name_is_in_it_and_nothing_else() -> None:
    names = {name for _, name in LISTED}
    assert {f"sdhj.{name}" for name in sdhj.__all__} - {"sdhj.__version__"} <= names
    assert {f"sdhj.plotting.{name}" for name in plotting.__all__} <= names
    for kind, name in LISTED:
        if kind == "class" and not name.endswith(".Failure"):
            page = (SITE / "api" / f"{name.split('.')[-1]}.md").read_text("utf-8")
            assert f".. autoclass:: {name}\n" in page and f"(api/{name.split('.')[-1]}.md)" in PAGES[0].read_text(
                "utf-8"
            )


def test_every_warning_and_error_that_a_user_meets_is_offered_by_the_package() -> None:
    own = re.compile(r"^class ([A-Z]\w*)\(\w*(?:Warning|Error|Exception)\)", re.MULTILINE)
    found = {name for path in (ROOT / "sdhj").rglob("*.py") for name in own.findall(path.read_text("utf-8"))}
    caught = {
        "Damaged",
        "GrowsTooFast",
        "Refusal",
        "Stated",
        "Unbounded",
    }  # not met by users
    assert found - caught <= set(sdhj.__all__) and len(found) >= 6
    assert {kind: issubclass(getattr(sdhj, kind), Warning) for kind in found & set(sdhj.__all__)} == {
        kind: kind.endswith("Warning") for kind in found & set(sdhj.__all__)
    }


def with_arguments() -> list[tuple[str, Any]]:
    found = []
    for kind, name in LISTED:
        if kind in ("function", "method", "member") and callable(given := object_of(name)):
            if set(inspect.signature(given).parameters) - {"self"}:
                found.append((name, given))
        elif kind == "class" and name.startswith("sdhj.") and name.count(".") == 1:
            found.append((name, object_of(name)))
    return found


@pytest.mark.parametrize(("name", "given"), [pytest.param(*one, id=one[0]) for one in with_arguments()])
def test_it_has_an_example(name: str, given: Any) -> None:
    """Doctests run the examples: `pytest sdhj`."""
    assert ">>> " in (inspect.getdoc(given) or ""), name

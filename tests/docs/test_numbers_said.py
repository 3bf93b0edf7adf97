"""A number with a unit, or a share, in the prose of a page is kept, follows from what is kept, or is excused here."""

import re
from collections.abc import Callable

import keep
import large
import numpy as np
import pytest
import rivals
from documents import ROOT, column

import sdhj
from sdhj.solver.recursion import GridParts, bytes_of_solve

NUMBER = r"(?<![\w.^*/-])(?:\d[\d,]*(?:\.\d+)?|\.\d+)"
UNIT = r"(?:%|per cent|core\s+hours?|CPU\s+s|ms|[µun]s|s|min|minutes?|hours?|h|[kMGT]B|seconds?)(?![\w/])"
QUOTED = re.compile(rf"{NUMBER}(?:\s+(?:to|and|or)\s+{NUMBER})?[\s-]*{UNIT}|(?<![\w.])0?\.\d{{2,}}(?![\w.])")

# What is no measurement of this library, by page: how it is written there, and why it is allowed.
PROBLEM = "of a problem that is told"
DEFINED = "a constant of the code, or what a word means"
REASONED = "follows from the numbers in the sentence"
EXCUSED: dict[str, dict[str, str]] = {
    "README": {"0.1 s": PROBLEM},
    "commands": {"512 MB": DEFINED, "1 GB": DEFINED, "256 MB": DEFINED},
    "formulas": {"128 MB": DEFINED},
    "numbers": {"10 ms": PROBLEM, "0.10": "a version", "0.1 ms": "with the H200 of that day"},
    "promises": {"95 %": DEFINED},
    "recipes": {
        "17 to 20 h": PROBLEM,
        "20 h": PROBLEM,
        "2.5 %": "tests/promises/test_shield.py asserts it",
        **dict.fromkeys((".073", ".138", ".088", ".241", ".157"), "what boxes lose, on 480 x 480 cells"),
        "41 %": REASONED,
        "8 %": REASONED,
    },
    "robot": {
        "64 kB": PROBLEM,
        "512 kB": PROBLEM,
        "4 MB": PROBLEM,
        ".08 µs": "dated, with its machine",
        ".11 µs": "dated, with its machine",
        "12 µs": "dated, with its machine",
        ".25 µs": "dated, with its machine",
        "5 kB": "gcc 12 -Os, with the others",
    },
    "syllabus": {"90 minutes": PROBLEM},
    "large": {},
}


def printed(name: str, pattern: str) -> float:
    """The number in a line that a command printed."""
    (found,) = re.findall(pattern, "\n".join(keep.kept(name)), re.MULTILINE)
    return float(found.replace(",", ""))


def h200(nodes: int) -> str:
    return f"{rivals.ON_H200[nodes]['game']} ms"


def h200_all(nodes: int) -> str:
    one = rivals.ON_H200[nodes]
    return f"{one['game'] + sum(one['besides'])} ms"


def h200_processor(nodes: int, digits: int) -> str:
    low, high = rivals.ON_H200[nodes]["solve"][-1]
    return f"{low / 1e3:.{digits}f} to {high / 1e3:.{digits}f} s"


def share(cells: str) -> str:
    return f".{column('exported', 'share proved', cells)[0].split('.')[1]}"


def size(cells: str, name: str) -> float:
    return float(column("exported", name, cells)[0].split()[0].replace(",", ""))


def packing() -> str:
    """Cells of the last row, times what each takes."""
    cells, each = column("exported", "cells")[-1], float(column("exported", "packing a cell")[-1].split()[0])
    return f"{eval(cells.replace('x', '*')) * each / 1e6:.0f} s"


def at_target() -> str:
    """Of 200,000 states of the arm with three links the share in the target and in nothing unsafe."""
    problem = large.WORKED["arm"].problem(9)
    states = np.random.default_rng(0).uniform(problem.grid.lower, problem.grid.upper, (200_000, problem.grid.ndim))
    inside = (problem.target_value(states, 0.0) <= 0) & (problem.unsafe_value(states, 0.0) > 0)
    return f".{100 * inside.mean():02.0f}"


def reference() -> str:
    """The share that the recursion on fine grids has inside within 8 steps, of the case study."""
    problem = sdhj.arm_case_study(25)
    with np.load(ROOT / "tests" / "data" / "reference_arm.npz") as file:
        inside = np.unpackbits(file["sign"][-1], count=problem.grid.size).astype(bool)
    return f"{problem.grid.fraction(inside.reshape(problem.grid.shape)):.2f}"


def needed(nodes: int) -> str:
    """The memory that a solve of the case study asks for before it begins."""
    return f"{bytes_of_solve(GridParts(sdhj.arm_case_study(nodes), sdhj.HJI())) / 1e9:.1f} GB"


SELECT, OF_40 = r"^select, rule deepest +([0-9.]+)", r"^ +40  default +([0-9.]+)"
# What follows from what a command printed, by page: how it is written there, and how it is computed.
KEPT: dict[str, dict[str, Callable[[], str]]] = {
    "README": {
        "20 µs": lambda: f"{10 * round(printed('bench', SELECT) / 10)} µs",
        "0.2 GB": lambda: f"{float(column('results', 'table, MB')[0]) / 1e3:.1f} GB",
        "4 s": lambda: f"{printed('timing', OF_40):.0f} s",
        "1.6 GB": lambda: needed(40),
        "2 %": lambda: f"{float(column('results', 'failures, worst')[0].strip('%')):.0f} %",
    },
    "large": {
        "42 GB": lambda: f"{41**5 * 45 * 8 / 1e9:.0f} GB",  # 45 tubes in single precision, as many rows of 25 marks
        "7.9 GB": lambda: f"{41**5 * 17 * 4 / 1e9:.1f} GB",  # 17 tubes in single precision
    },
    "numbers": {
        ".05": at_target,
        "0.41": reference,
        "23 ms": lambda: h200(25),
        "71 ms": lambda: h200(40),
        "0.31 to 0.47 s": lambda: h200_processor(25, 2),
        "1.6 to 2.0 s": lambda: h200_processor(40, 1),
        "125 ms": lambda: h200_all(25),
        "530 ms": lambda: h200_all(40),
    },
    "robot": {
        ".202": lambda: share("64 x 64 x 63"),
        ".250": lambda: share("120 x 120 x 126"),
        ".285": lambda: share("240 x 240 x 340"),
        "40 s": packing,
        "16 kB": lambda: f"{4 * 2 * 5 * 400 / 1e3:.0f} kB",
    },
}


def prose(page: str) -> str:
    """A page without code, quoted commands, formulas, comments and what a script wrote."""
    text = keep.MARK.sub("", page)
    for left_out in (
        r"^```.*?^```$",
        r"<!-- promises: .*?(?=\n\n- )",
        r"<!--.*?-->",
        r"\$\$.*?\$\$",
        r"\$[^$\n]*\$",
        r"`[^`]*`",
        r"\]\([^)]*\)",
    ):
        text = re.sub(left_out, "]", text, flags=re.MULTILINE | re.DOTALL)
    return text


def said(page: str) -> list[str]:
    """Numbers with a unit, and shares, in the prose of a page."""
    return [" ".join(found.split()) for found in QUOTED.findall(prose(page))]


@pytest.mark.parametrize("page", keep.PAGES, ids=lambda page: page.stem)
def test_numbers_are_kept_or_excused(page) -> None:
    allowed = {**EXCUSED.get(page.stem, {}), **KEPT.get(page.stem, {})}
    found = said(page.read_text("utf-8"))
    assert [number for number in found if number not in allowed] == []
    assert [number for number in allowed if number not in found] == []  # what is no longer there


@pytest.mark.parametrize("page", KEPT)
def test_what_is_said_follows_from_what_was_printed(page: str) -> None:
    for number, computed in KEPT[page].items():
        assert computed() == number


def test_a_new_number_is_found() -> None:
    page = next(page for page in keep.PAGES if page.stem == "robot").read_text("utf-8")
    assert said(page + "\nIt takes 3.5 s, or .77 of\nit, and `4 s`.\n")[-2:] == ["3.5 s", ".77"]

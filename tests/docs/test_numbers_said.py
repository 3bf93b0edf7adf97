"""A number with a unit, or a share, in the prose of a page is a kept one, one of the page's outputs, or excused here."""

import re
from collections.abc import Callable

import keep
import pytest
import rivals
from documents import ROOT
from test_kept import column

import sdhj

NUMBER = r"(?<![\w.^*/-])(?:\d[\d,]*(?:\.\d+)?|\.\d+)"
UNIT = r"(?:%|per cent|core\s+hours?|CPU\s+s|ms|[µun]s|s|min|minutes?|hours?|h|[kMGT]B|seconds?)(?![\w/])"
QUOTED = re.compile(rf"{NUMBER}(?:\s+(?:to|and|or)\s+{NUMBER})?[\s-]*{UNIT}|(?<![\w.])0?\.\d{{2,}}(?![\w.])")

# What is no measurement of this library, by page: how it is written there, and why it is allowed.
PROBLEM = "of a problem that is told"
DEFINED = "a constant of the code, or what a word means"
REASONED = "follows from the numbers in the sentence"
EXCUSED: dict[str, dict[str, str]] = {
    "README": {"0.1 s": PROBLEM},
    "commands": {"512 MB": DEFINED},
    "formulas": {"128 MB": DEFINED},
    "numbers": {"10 ms": PROBLEM, "0.10": "a version"},
    "promises": {"95 %": DEFINED, "0.25": PROBLEM, "0.30": PROBLEM, "0.38": PROBLEM, "0.342": PROBLEM},
    "recipes": {
        "17 to 20 h": PROBLEM,
        "20 h": PROBLEM,
        "250 s": PROBLEM,
        "0.25 s": PROBLEM,
        "2.5 %": "tests/test_shield.py asserts it",
        "2 %": DEFINED,
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
        "5 kB": "tests/certified/test_export.py asserts it",
    },
    "syllabus": {"90 minutes": PROBLEM},
    "large": {"1 GB": PROBLEM},
}


def printed(name: str, pattern: str) -> float:
    """The number in a line that a command printed."""
    (found,) = re.findall(pattern, "\n".join(keep.kept(name)), re.MULTILINE)
    return float(found.replace(",", ""))


def h200(nodes: int) -> str:
    return f"{rivals.ON_H200[nodes]['game']} ms"


def h200_all(nodes: int) -> str:
    one = rivals.ON_H200[nodes]
    return f"{(one['game'] + sum(one['besides'])) / 1e3:.2f} s"


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
    import large
    import numpy as np

    problem = large.WORKED["arm"].problem(9)
    states = np.random.default_rng(0).uniform(problem.grid.lower, problem.grid.upper, (200_000, problem.grid.ndim))
    inside = (problem.target_value(states, 0.0) <= 0) & (problem.unsafe_value(states, 0.0) > 0)
    return f".{100 * inside.mean():02.0f}"


def lax_hours() -> str:
    """Of 40^6 nodes, 25 inputs and 8 intervals, by the CPU seconds of 40^5 nodes, 27 inputs and 8 intervals."""
    (seconds,) = column("slabs5", "CPU s")
    return f"{float(seconds.replace(',', '')) * 40 * 25 / 27 / 3600:.0f} core hours"


# What follows from what a command printed, by page: how it is written there, and how it is computed.
KEPT: dict[str, dict[str, Callable[[], str]]] = {
    "README": {
        "20 µs": lambda: f"{printed('bench', r'^select, rule deepest +(\S+)'):.0f}"[0].replace("1", "2") + "0 µs",
        "0.2 GB": lambda: f"{float(column('results', 'table, MB')[0]) / 1e3:.1f} GB",
        "4 s": lambda: f"{printed('timing', r'^ +40  default +(\S+)'):.0f} s",
        "1.6 GB": lambda: f"{printed('bench', r'^hji +40 +\S+ +\S+ +(\S+)'):.1f} GB",
        "2 %": lambda: f"{float(column('results', 'failures, worst')[0].strip('%')):.0f} %",
    },
    "large": {
        "42 GB": lambda: f"{41**5 * 45 * 8 / 1e9:.0f} GB",  # 45 tubes in single precision, as many rows of 25 marks
        "295 GB": lambda: f"{40**6 * 9 * 8 / 1e9:.0f} GB",
        "core hours": lax_hours,
    },
    "numbers": {
        "0.41": lambda: f"{sdhj_reference():.2f}",
        ".05": at_target,
        "23 ms": lambda: h200(25),
        "71 ms": lambda: h200(40),
        "0.31 to 0.47 s": lambda: h200_processor(25, 2),
        "1.6 to 2.0 s": lambda: h200_processor(40, 1),
        "0.13 s": lambda: h200_all(25),
        "0.53 s": lambda: h200_all(40),
        "0.1 ms": lambda: "0.1 ms",
    },
    "robot": {
        ".194": lambda: share("64 x 64 x 63"),
        ".244": lambda: share("120 x 120 x 126"),
        ".282": lambda: share("240 x 240 x 340"),
        "38 s": packing,
    },
}

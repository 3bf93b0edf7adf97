"""What tables answer and what users' functions say is what it was: see `record_digests` and `record_functions`."""

import subprocess
import sys

import numpy as np
import pytest
import record_functions
from digest_cases import CASES
from record_digests import differences, far, largest_change, machine, measured, recorded

RECORDED = recorded()
# One for each method, and of the games on one to four axes, for what other tests compile too; the rest is slow.
QUICK = {
    "line",
    "line, lax",
    "torus",
    "plane, turned adversary",
    "cart, safe ends, certified",
    "car",
    "evader, projected",
    "arm, lax",
}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in QUICK else pytest.mark.slow) for name in CASES]
)
def test_nothing_has_changed(name):
    """On the machine of the record to the last bit, on another one but for rounding."""
    compared = differences if RECORDED["machine"] == machine() else far
    assert compared(name, RECORDED["cases"][name], measured(CASES[name])) == []


def test_every_record_has_its_case():
    assert list(RECORDED["cases"]) == list(CASES)
    assert set(CASES) >= QUICK


def test_what_changes_is_told():
    before = RECORDED["cases"]["line"]
    assert differences("line", before, before) == far("line", before, before) == []
    numbers = before["numbers"] | {"sum": before["numbers"]["sum"] * (1 + 1e-6)}
    (line,) = differences("line", before, before | {"values": "0", "numbers": numbers})
    assert line == "line: values changed; of their plain numbers most the sum, by 1e-06 of it"
    assert far("line", before, before | {"values": "0", "numbers": numbers}) == []
    assert "by 1e-06" in differences("line", before, before | {"numbers": numbers})[0]
    (line,) = differences("line", before, before | {"held": [1, 2], "inputs": before["inputs"]})
    assert line.startswith("line: held changed from [") and line.endswith("to [1, 2]")
    larger = before["numbers"] | {"most": before["numbers"]["most"] + 1.0}
    assert "most of the values changed by" in far("line", before, before | {"numbers": larger})[0]
    assert largest_change(before["numbers"], {}) == (float("inf"), f"there are others: {', '.join(sorted(numbers))}")


# ---- functions of users


@pytest.mark.slow
def test_functions_have_the_values_they_had():
    """In a process of its own: the code that makes problems is run with the package's insides replaced."""
    done = subprocess.run([sys.executable, record_functions.__file__], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_function_that_changes_is_told(rng):
    values = rng.normal(size=(record_functions.STATES, 2))
    before, beside = record_functions.Kept.of(values), values * (1 + 1e-15)
    assert record_functions.difference(before, record_functions.Kept.of(beside)) == ""
    beside[777, 1] += 1e-10
    assert "less than one sees singly" in record_functions.difference(before, record_functions.Kept.of(beside))
    beside[777, 1] += 0.1
    assert "most at state 777" in record_functions.difference(before, record_functions.Kept.of(beside))
    one = record_functions.Kept.of(values[:, :1])
    assert record_functions.difference(before, one) == "has 1 components, and had 2"
    said = record_functions.differences({"a": before, "b": before}, {"b": before, "c": before})
    assert said == ["a: recorded, and no longer there", "c: nothing is recorded of it"]


def test_calls_that_make_parts_are_found():
    code = (
        "import sdhj\npart = sdhj.UnsafeSet(\n    (0,), f\n)\nsame = UnsafeSet.from_map(x)\nboth = [TargetSet(a), g()]"
    )
    assert record_functions.places_of(code) == [(2, 4), (6, 6)]


def test_all_that_is_recorded_comes_back(rng, tmp_path, monkeypatch):
    """Also rows that two functions share, and functions of some components."""
    monkeypatch.setattr(record_functions, "RECORD", tmp_path / "functions.npz")
    one, two = rng.normal(size=(2, record_functions.STATES, 3))
    two[:, 0] = one[:, 2]
    kept = {"one": record_functions.Kept.of(one), "two": record_functions.Kept.of(two)}
    record_functions.write(kept)
    assert np.load(tmp_path / "functions.npz")["values"].shape == (5, record_functions.STATES)
    assert record_functions.differences(kept, record_functions.recorded()) == []

"""What whoever verifies a file may ask, what is counted of it, and what is printed: all against texts by hand."""

import io
import re
import runpy
import sys
import time

import numpy as np
import pytest
from forged_robots import FORGERIES, file_of, solved
from room import room

from sdhj.certified.check import Claim, Verdict, shown, verify
from sdhj.certified.check.claims import CLEAR, Count
from sdhj.certified.check.reading import head_and_arrays
from sdhj.certified.export import FIELDS, packed_table


@pytest.fixture(scope="module")
def plane(tmp_path_factory):
    """The file of a robot in the plane, and a folder with its export."""
    path = tmp_path_factory.mktemp("plane") / "table.npz"
    path.write_bytes(file_of("plane"))
    (path.parent / "sdhj_table.bin").write_bytes(packed_table(solved("plane"), FIELDS, "deepest", 0, False))
    return path


def made_and_checked(verdict):
    return {claim.name: (claim.made, claim.checked, claim.beside) for claim in verdict.claims}


def test_claims_are_counted_and_the_first_failures_of_all_kept():
    total = Count(3, 2)
    total.beside = 1
    for failed, beside in (([4, 5, 6], 10), ([], 0), ([7, 8, 9, 10], 1000)):
        one = Count(2000, 1000, failed, "start 0, cell ")
        one.beside = beside
        total.add(one)
    cells = [f"start 0, cell {cell}" for cell in (4, 5, 6, 7, 8)]
    assert total.claim("moves") == Claim("moves", 6003, 3002, cells, 7, 1011)
    assert Count(9, 9, range(3, 12), "cell ").claim("clear") == Claim(
        "clear", 9, 9, ["cell 3", "cell 4", "cell 5", "cell 6", "cell 7"], 9
    )


def test_a_claim_is_told_in_lines():
    names = [f"cell {number}" for number in range(7)]
    found = Verdict(
        (
            Claim("moves", 1200, 1200, []),
            Claim("clear", 1200, 1199, [], 0, 3000),
            Claim("nearer", 5000, 5000, names[:5], 1234),
            Claim("cover", 2, 2, names),
        )
    )
    first = [f"    cell {number}" for number in range(5)]
    told = [
        "moves: 1,200 of 1,200 checked, proved",
        "clear: 1,199 of 1,200 checked, no fault in these; 3,000 of cells that are not promised were not looked at",
        "nearer: 5,000 of 5,000 checked, 1,234 NOT proved",
        *first,
        "cover: 2 of 2 checked, 7 NOT proved",
        *first,
    ]
    assert str(found) == "\n".join(told) and not found.ok
    assert Verdict(found.claims[:2]).ok and [claim.failed for claim in found.claims] == [0, 0, 1234, 7]


def test_what_is_asked_for_is_looked_at(plane):
    """Cells that are promised or all, as many as are wanted, drawn by the seed, of the export as well."""
    found = {
        (every, samples, seed): verify(
            plane, everywhere=every, samples=samples, seed=seed, exported=plane.parent, progress=False
        )
        for every, samples, seed in (
            (False, None, 0),
            (True, None, 0),
            (False, 40, 0),
            (False, np.int64(40), np.uint8(1)),
        )
    }
    assert all(one.ok and "3 intervals of 0.25 s" in one.problem for one in found.values())
    some, every, few, other = map(made_and_checked, found.values())
    for name in (CLEAR, "exported: clear"):
        made, checked, beside = some[name]
        assert 0 < made == checked < every[name][0] == made + beside == every[name][1] and not every[name][2]
    assert all(made == checked for name, (made, checked, _) in (some | every).items())
    for name in (CLEAR, "one step nearer", "in the target, and safe"):
        assert 0 < few[name][1] < few[name][0]
    inside = few[CLEAR][1] + few["one step nearer"][1]
    assert 0 < inside < some[CLEAR][0] and inside != other[CLEAR][1] + other["one step nearer"][1]
    assert {name: one[0] for name, one in few.items()} == {name: one[0] for name, one in some.items()}
    assert made_and_checked(verify(plane, samples=10**6, progress=False)).items() <= some.items()


@pytest.mark.parametrize("progress", [True, False, None, "terminal", "none"])
def test_how_far_it_is_is_told_where_somebody_looks(progress, plane, monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr(stream, "isatty", lambda: progress == "terminal", raising=False)
    monkeypatch.setattr(sys, "stderr", None if progress == "none" else stream)
    asked = {} if isinstance(progress, str) else {"progress": progress}
    assert verify(plane, samples=1, exported=plane.parent, **asked).ok
    told = re.findall(r"(\w+): [\d,]+ of ([\d,]+)\n", stream.getvalue())
    some = [("moves", "4"), ("sets", "10"), ("exported", "4")]
    assert told == (some if progress in (True, "terminal") else []), stream.getvalue()


def test_progress_is_told_ten_times_a_second_and_at_the_end(monkeypatch):
    now, flushed, stream = [100.0], [], io.StringIO()
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(stream, "flush", lambda: flushed.append(stream.getvalue()), raising=False)
    monkeypatch.setattr(sys, "stderr", stream)
    through = []
    for one in shown(iter(range(1200)), "moves", 1200):
        through.append(one)
        now[0] += 0.04
    assert through == [*range(1200)]
    told = [f"\rmoves: {number:,} of 1,200" for number in range(1, 1200, 3)] + ["\rmoves: 1,200 of 1,200\n"]
    assert stream.getvalue() == "".join(told) and flushed[0] == told[0] and len(flushed) == len(told)


def test_the_module_says_its_verdict_and_ends_with_it(plane, monkeypatch, capsys, tmp_path):
    forgery = FORGERIES["a cell more"]
    false, none = forgery.write(file_of(forgery.robot), tmp_path / "false.npz"), tmp_path / "none.npz"
    none.write_text("no table")
    for given, status, told, error in (
        ([str(plane)], 0, "moves: .*\none step nearer: ([\\d,]+) of \\1 checked, proved\n$", "^$"),
        ([str(false)], 1, "one step nearer: .* 1 NOT proved\n    start 0, within 1, cell \\d+\n", "^$"),
        ([str(none)], 2, "^$", "^Error: .*none.npz is damaged"),
        ([str(tmp_path / "nowhere.npz")], 2, "^$", "^Error: no file "),
        ([], "usage: .*TABLE.npz", "^$", "^$"),
        ([str(plane), "more"], "usage: ", "^$", "^$"),
    ):
        monkeypatch.setattr(sys, "argv", ["check", *given])
        with pytest.raises(SystemExit) as ended:
            runpy.run_module("sdhj.certified.check", run_name="__main__")
        text, wrong = capsys.readouterr()
        assert ended.value.code == status or re.match(str(status), str(ended.value.code))
        assert re.search(told, text, re.DOTALL) and re.search(error, wrong), (given, text, wrong)
    monkeypatch.setattr(sys, "argv", ["check", str(plane)])
    with room(0), pytest.raises(SystemExit, match="2"):
        runpy.run_module("sdhj.certified.check", run_name="__main__")
    assert capsys.readouterr().err.startswith("Error: to check the file takes ")


def test_a_check_asks_for_its_memory_before_it_begins(plane):
    """More than its arrays take, which are there already."""
    with head_and_arrays(plane) as (_, arrays):
        there = arrays.nbytes
    for nbytes in (2 * there, there - 1):
        with pytest.raises(MemoryError, match="samples=1000"), room(nbytes):
            verify(plane, samples=1, progress=False)
    with room(there), head_and_arrays(plane) as (_, arrays):
        assert arrays.nbytes == there
    with pytest.raises(MemoryError, match="samples=1000"), room(there - 1), head_and_arrays(plane):
        pass

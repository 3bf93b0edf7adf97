"""Digests of what tables of every method answer on the problems of `digest_cases`: whether anything has changed.

    python tests/record_digests.py --write          writes tests/data/digests.json
    python tests/record_digests.py                  compares with it, and says what is different
    python tests/record_digests.py "arm, swept"     only these cases; with --write too

Only what `import sdhj` offers is used. What is recorded of each case, values apart from answers, so that one can see
that values changed in their last bits and the answers did not:

* `values`: the level-set functions of all (start, within), step after step, in each `within` ascending; `numbers` are
  beside them, plain ones that tell how large a change is;
* `margins`: numbers at states between the nodes, such as what the controller's look-ahead finds;
* `inputs`, `contains`, `controller`, `runs`, `paths`, `cells`: answers, the last two the states of runs as numbers, and
  the cells of certified tables;
* `problem`, `warnings`, `file`: its digest, what was warned of, whether a saved table comes back as it was.

Bits of sines and of compiled kernels hang on processor and libraries: what they were is recorded, and on others
`tests/campaign/test_digests.py` compares the plain numbers alone.
"""

import argparse
import json
import platform
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Sequence
from hashlib import blake2b
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import codegen
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

import sdhj

HERE = Path(__file__).parent
if __name__ == "__main__":
    sys.path.insert(1, str(HERE / "lib"))  # as pytest has it

from digest_cases import CASES, Case  # noqa: E402

RECORD = HERE / "data" / "digests.json"
POINTS = 150  # states of each kind that are asked about at once
SINGLE = 20  # states that are asked about one by one
RUNS = 50
MANY = 8  # steps; of tables with more only three rows are looked at
ADVERSARIES = ("worst", "random", "aggressive")
RULES = ("deepest", "effort", "target", "clearance")
CLOSE = 1e-4  # relative, of plain numbers on another machine


class Digest:
    """BLAKE2 of arrays, numbers and words, one after the other."""

    def __init__(self) -> None:
        self.state = blake2b(digest_size=16)

    def add(self, *parts: Any) -> None:
        for part in parts:
            if isinstance(part, np.ndarray):
                self.state.update(f"{part.dtype.str} {part.shape}".encode())
                self.state.update(np.ascontiguousarray(part).tobytes())
            else:
                self.state.update(repr(part).encode())

    def __str__(self) -> str:
        return self.state.hexdigest()


def machine() -> dict[str, str]:
    """What the last bits hang on."""
    return {
        "processor": f"{platform.machine()} {codegen.ll.get_host_cpu_name()}",
        "numpy": np.__version__,
        "loops": " ".join(name for name in __cpu_dispatch__ if __cpu_features__[name]),  # NumPy's for this processor
        "numba": numba.__version__,
    }


def entries(table: Any) -> list[tuple[int, int]]:
    """(start, within) in their order: all of a table of few steps, else those of the first step, a middle and last."""
    steps = table.steps
    starts = range(steps + 1) if steps <= MANY else (0, steps // 2, steps)
    return [(start, within) for start in starts for within in range(steps - start + 1)]


def states_of(table: Any, count: int, seed: int) -> Any:
    """Random states (2 count, ndim), some past the ends of the grid; half of them about nodes of the largest tube."""
    grid, rng = table.grid, np.random.default_rng(seed)
    lower, upper = np.array(grid.lower), np.array(grid.upper)
    past = 0.04 * (upper - lower)
    anywhere = rng.uniform(lower - past, upper + past, (count, grid.ndim))
    inside = grid.points()[np.flatnonzero(table.values(start=0, within=table.steps) <= 0)]
    about = inside[rng.integers(0, len(inside), count)] if len(inside) else anywhere
    return np.concatenate([anywhere, about + rng.uniform(-0.7, 0.7, about.shape) * grid.spacing])


def of_values(table: Any) -> dict[str, Any]:
    """Values and inputs at all nodes, and plain numbers of the values."""
    values, inputs, numbers, kept = Digest(), Digest(), {}, []
    for start, within in entries(table):
        tube = np.asarray(table.values(start=start, within=within))
        values.add(start, within, tube)
        inputs.add(start, within, np.packbits(table.inputs(start=start, within=within)))
        kept.append(tube[np.isfinite(tube)].astype(np.float64))
        if start == 0:
            numbers[f"share within {within}"] = float(table.fraction(start=0, within=within))
    finite = np.concatenate(kept)
    numbers |= {"least": float(finite.min()), "most": float(finite.max())}
    numbers |= {"sum": float(finite.sum()), "sum of squares": float((finite**2).sum())}
    return {"values": str(values), "inputs": str(inputs), "numbers": numbers}


def of_states(table: Any) -> dict[str, Any]:
    """Which tubes hold random states, and what a controller says of many at once, by every rule."""
    problem, steps, states = table.problem, table.steps, states_of(table, POINTS, 1)
    contains, margins, answers = Digest(), Digest(), Digest()
    held = []
    for start, within in entries(table):
        inside = table.contains(states, start=start, within=within)
        contains.add(inside)
        margins.add(table.values_at(states[:, None], start, np.full(len(states), within)))
        held += [int(inside.sum())] if start == 0 else []
    rng = np.random.default_rng(2)
    wanted = rng.integers(0, len(problem.inputs), len(states))
    commands = problem.inputs[wanted] + rng.normal(0.0, 0.2, problem.inputs[wanted].shape)
    for step in sorted({0, steps // 2, steps - 1, steps}):
        batch = table.batch(states, step)
        answers.add(step, batch.steps_to_go, batch.safe, batch.promised)
        margins.add(batch.margins)
        for rule in RULES:
            answers.add(rule, sdhj.Controller(table, rule=rule).choose(batch))
        if step < steps:
            margins.add(table.hazards(states, step))
            for asked in (wanted, commands):
                told = sdhj.Controller(table).filter(states, step, asked)
                answers.add(told.inputs, told.changed, told.overruled, told.promised, told.fallback)
    return {"contains": str(contains), "held": held, "margins": margins, "controller": answers}


def of_single_states(table: Any, margins: Digest, answers: Digest) -> list[Any]:
    """What a controller says of a state at a time; the answers of the first step, to be read by people."""
    controller, read = sdhj.Controller(table), []
    states = states_of(table, POINTS, 3)
    known = table.batch(states, 0).steps_to_go >= 0
    chosen = np.concatenate([states[known][: SINGLE // 2], states[~known][: SINGLE // 2]])
    for step in sorted({0, table.steps // 2, table.steps - 1}):
        for state in chosen:
            said: list[Any] = [controller.steps_to_go(state, step)]
            for question in (controller.safe_inputs, controller.select):
                try:
                    said.append(np.asarray(question(state, step)).tolist())
                except sdhj.NotAdmissible:
                    said.append("not admissible")
            away = controller.fallback(state, step)
            answers.add(said, away.input, away.steps)
            margins.add(away.hazard)
            read += [said[0]] if step == 0 else []
    if table.problem.sensing:
        of_a_loop(table, chosen, margins, answers)
    return read


def of_a_loop(table: Any, states: Any, margins: Digest, answers: Digest) -> None:
    """What a controller says in a loop whose clock is a little off."""
    for state in states:
        controller = sdhj.Controller(table)
        margins.add(controller.predict(state, 0, 0))
        for step in range(table.steps):
            action = controller.step(state, step * table.problem.delta + 0.001 * (step % 2))
            answers.add(action.input, action.step, action.steps_to_go, action.promised, action.missed)
            margins.add(action.late)


def of_runs(table: Any) -> dict[str, Any]:
    """How runs end against each adversary, and where they go."""
    controller, runs, paths, counts = sdhj.Controller(table), Digest(), Digest(), {}
    for adversary in ADVERSARIES:
        report = sdhj.monte_carlo(controller, RUNS, adversary, seed=4, progress=False)
        counts[adversary] = {outcome: count for outcome, count in report.counts.items() if count}
        runs.add(adversary, report.outcomes, report.steps)
        paths.add(report.starts)
        run = sdhj.simulate(controller, report.starts[0], adversary, seed=5)
        runs.add(run.outcome, run.inputs, run.steps_to_go)
        paths.add(run.times, run.states, run.disturbances)
    return {"runs": str(runs), "paths": str(paths), "ended": counts}


def of_cells(table: Any) -> dict[str, Any]:
    """The cells of a certified table."""
    if table.method != "certified":
        return {}
    cells = Digest()
    for start, within in entries(table):
        cells.add(np.packbits(table.bits(start=start, within=within)))
    return {"cells": str(cells)}


def of_file(table: Any, path: Path) -> bool:
    """Whether a saved table comes back as it was."""
    table.save(path)
    back, whole = sdhj.load(path, problem=table.problem), True
    for start, within in entries(table):
        whole &= np.array_equal(
            back.values(start=start, within=within), table.values(start=start, within=within), equal_nan=True
        )
        whole &= np.array_equal(back.inputs(start=start, within=within), table.inputs(start=start, within=within))
    return bool(whole)


def measured(case: Case) -> dict[str, Any]:
    """All that is recorded of a case."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        problem = case.problem()
        stored = {"store": Path(folder) / "table"} if case.stored else {}
        table = sdhj.solve(problem, case.method, progress=False, play=False, **stored)
        states = of_states(table)
        read = of_single_states(table, states["margins"], states["controller"])
        found = of_values(table) | states | {"to go": read} | of_runs(table) | of_cells(table)
        found |= {"file": of_file(table, Path(folder) / "table.npz"), "problem": table.problem.digest}
        found |= {"steps": table.steps, "stored tubes": len(table.index), "says": repr(table)}
    found["warnings"] = sorted(f"{one.category.__name__}: {one.message}" for one in told)
    return {key: str(value) if isinstance(value, Digest) else value for key, value in found.items()}


def largest_change(before: dict[str, float], now: dict[str, float]) -> tuple[float, str]:
    """The largest relative change of plain numbers, and of which."""
    if before.keys() != now.keys():
        return float("inf"), f"there are others: {', '.join(sorted(before.keys() ^ now.keys()))}"
    changes = [(abs(now[key] - old) / max(abs(old), abs(now[key]), 1e-300), key) for key, old in before.items()]
    return max(changes)


def differences(name: str, before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """One line for everything that is not as it was recorded."""
    lines = []
    for key in sorted({*before, *now} - {"numbers"}):
        old, new = (json.loads(json.dumps(one.get(key, "nothing"))) for one in (before, now))
        if old == new:
            continue
        if key == "values":
            change, which = largest_change(before["numbers"], now["numbers"])
            lines.append(f"{name}: values changed; of their plain numbers most the {which}, by {change:.2g} of it")
        else:
            lines.append(f"{name}: {key} changed from {_short(old)} to {_short(new)}")
    if before.get("values") == now.get("values") and before["numbers"] != now["numbers"]:
        change, which = largest_change(before["numbers"], now["numbers"])
        lines.append(f"{name}: values are as before and their plain numbers are not, most the {which}, by {change:.2g}")
    return lines


def _short(value: Any) -> str:
    text = str(value)
    return text if len(text) <= 300 else text[:297] + "..."


def far(name: str, before: dict[str, Any], now: dict[str, Any]) -> list[str]:
    """As `differences`, of another machine than that of the record: only what is no matter of rounding."""
    change, which = largest_change(before["numbers"], now["numbers"])
    return [f"{name}: the {which} of the values changed by {change:.2g} of it"] if change > CLOSE else []


def recorded() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(RECORD.read_text(encoding="utf-8"))
    return found


def write(cases: dict[str, Any]) -> None:
    """Record cases, one line for each field, so that a difference of two versions of the file can be read."""
    parts = []
    for name, found in cases.items():
        fields = (f"   {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}" for key, value in found.items())
        parts.append(f"  {json.dumps(name)}: {{\n" + ",\n".join(fields) + "\n  }")
    text = f'{{\n "machine": {json.dumps(machine())},\n "cases": {{\n' + ",\n".join(parts) + "\n }\n}\n"
    RECORD.write_text(text, encoding="utf-8")


def each(names: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """The cases of these names, measured one after the other, with how long each took."""
    for name in names:
        began = time.perf_counter()
        found = measured(CASES[name])
        print(f"{time.perf_counter() - began:6.2f} s  {name}", flush=True)
        yield name, found


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="CASE", help="only these, by default all")
    parser.add_argument("--write", action="store_true", help="record what is found")
    given = parser.parse_args(arguments)
    if unknown := sorted(set(given.names) - set(CASES)):
        parser.error(f"there is no case {', '.join(map(repr, unknown))}")
    names = given.names or list(CASES)
    known = recorded() if RECORD.exists() else {"machine": machine(), "cases": {}}
    if given.write:
        if given.names and known["machine"] != machine():
            parser.error("the record is of another machine: write all cases")
        kept = known["cases"] | dict(each(names))
        write({name: kept[name] for name in CASES if name in kept})
        return 0
    if known["machine"] != machine():
        print(f"recorded on another machine, {known['machine']}; this one is {machine()}: bits may differ for that")
    lines = []
    for name, found in each(names):
        before = known["cases"].get(name)
        lines += differences(name, before, found) if before else [f"{name}: nothing is recorded of it"]
    if not given.names:
        lines += [f"{name}: recorded, but there is no such case" for name in known["cases"] if name not in CASES]
    print(*lines, sep="\n", end="\n" if lines else "")
    print(f"{len(lines)} differences" if lines else "nothing has changed")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())

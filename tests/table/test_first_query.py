"""The first answer of a controller prepares nothing: neither compiled code nor what look-ups read of a problem."""

import subprocess
import sys

import numpy as np
import pytest
from zoo import interval_problem, torus_problem, unicycle_problem

import sdhj
from sdhj.table import batches

CASES = {
    "grid": (unicycle_problem, "hji"),
    "moving": (torus_problem, "hji"),
    "certified": (interval_problem, sdhj.Certified(cells=[80])),
}


@pytest.mark.parametrize(("name", "rule"), [*((name, "effort") for name in CASES), ("moving", "deepest")])
def test_what_look_ups_read_is_there(name, rule, tmp_path, monkeypatch):
    make, method = CASES[name]
    solved = sdhj.solve(make(), method, progress=False, play=True)
    solved.save(tmp_path / "table.npz")
    made, prepared = [], batches.tape_of_problem
    monkeypatch.setattr(batches, "tape_of_problem", lambda *given: made.append(given[1]) or prepared(*given))
    for table in (solved, sdhj.load(tmp_path / "table.npz")):
        controller = sdhj.Controller(table, rule=rule)
        made.clear()
        states = np.random.default_rng(1).uniform(table.grid.lower, table.grid.upper, (200, table.grid.ndim))
        states = states[controller.batch(states, 0).steps_to_go > 0]
        assert len(states) and (controller.select(states[0], 0), controller.step(states[1], 0.0)) and not made


@pytest.mark.usefixtures("solves_are_played")
def test_what_a_solve_prepared_is_kept_with_its_details():
    table = sdhj.solve(interval_problem(), progress=False)
    told = table.with_details(dict(table.details) | {"more": 1})
    assert told.details["more"] == 1 and "more" not in table.details
    assert "played" in table.details and all(a is b for a, b in zip(told.tape_at(0), table.tape_at(0), strict=True))


PROGRAM = """
import importlib, pkgutil, sys
import numpy as np
import sdhj, sdhj.kernels
from numba.core.dispatcher import Dispatcher
table = sdhj.load(sys.argv[1])
controller = sdhj.Controller(table, rule=sys.argv[2])
modules = [one for name, one in sys.modules.items() if name.startswith("sdhj.kernels")]
kernels = {id(one): one for module in modules for one in vars(module).values() if isinstance(one, Dispatcher)}
loaded = {one: len(kernel.overloads) for one, kernel in kernels.items()}
states = np.random.default_rng(1).uniform(table.grid.lower, table.grid.upper, (2000, table.grid.ndim))
states = states[table.contains(states)]
assert len(kernels) > 20 and any(loaded.values()) and len(states) > 3
loaded = {one: len(kernel.overloads) for one, kernel in kernels.items()}
for state in states[:3]:
    controller.step(state, 0.0), controller.filter(state, 0, 0), controller.fallback(state, 0)
    controller.steps_to_go(state, 0), controller.safe_inputs(state, 0)
print([kernels[one].__name__ for one, count in loaded.items() if len(kernels[one].overloads) != count])
"""


@pytest.mark.slow
@pytest.mark.parametrize(("name", "rule"), [*((name, "clearance") for name in CASES), ("moving", "deepest")])
def test_no_compiled_code_is_loaded_by_an_answer(name, rule, tmp_path):
    """In a process that has only loaded the table."""
    make, method = CASES[name]
    sdhj.solve(make(), method, progress=False, play=False).save(tmp_path / "table.npz")
    asked = [sys.executable, "-W", "ignore", "-c", PROGRAM, str(tmp_path / "table.npz"), rule]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.strip() == "[]"

"""Nothing that is handed out can be written through: every array is read-only, or a copy."""

import copy
import inspect
import json
import pickle
import subprocess
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numba
import numpy as np
import pytest
import zoo
from numba.core import types

import sdhj
from sdhj.common.remembering import Sealed

MOVES = 0.5 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1.0]])
GRID = sdhj.Grid([-2, -2], [2, 2], [21, 21])
WITH_A_CURRENT = lambda q, u, t: u - 0.1 * q + 0.05 * t  # noqa: E731
START = np.array([0.45, 0.45])
LEFT_OUT = (
    "played",
    "save",
    "explain",
    "rules",
    "value_array",
    "mask_array",
    "share",
    "reusable",
    "player",
)  # slow, or a table's own


def problem_of(**changes):
    parts = {
        "grid": GRID,
        "dynamics": sdhj.Dynamics(MOVES, lambda q, u: u - 0.1 * q, np.eye(2), [0.03, 0.03]),
        "target": sdhj.TargetSet((0, 1), lambda p, t: np.hypot(p[:, 0] - 1.0, p[:, 1] - 0.8) - 0.6),
        "unsafe": [sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] + 1, p[:, 1]) - 0.4, name="post")],
        "delta": 0.25,
        "steps": 6,
    }
    return zoo.plane(**parts | changes)


CASES = {
    "hji": (problem_of, "hji"),
    "lax": (lambda: problem_of(dynamics=sdhj.Dynamics(MOVES, MOVES, np.eye(2), [0.03, 0.03])), "lax"),
    "timed": (lambda: problem_of(dynamics=sdhj.Dynamics(MOVES, WITH_A_CURRENT, np.eye(2), [0.03, 0.03])), "hji"),
    "certified": (problem_of, sdhj.Certified(cells=[80, 80])),
    "sensing": (lambda: problem_of(sensing=sdhj.Sensing(error=0.01, delay=0.02, memory=False)), "hji"),
    "moving": (
        lambda: problem_of(unsafe=[sdhj.UnsafeSet((0, 1), lambda p, t: np.hypot(p[:, 0] + 1 - t, p[:, 1] + 1) - 0.3)]),
        "hji",
    ),
}
ARGUMENTS = {  # of methods that need some
    "points": START[None],
    "states": START[None],
    "q": START,
    "measurement": START,
    "wanted": MOVES[1],
    "step": 0,
    "start": 0,
    "within": 3,
    "time": 0.0,
    "t": 0.0,
    "axis": 0,
    "j": 0,
    "axes": (0, 1),
    "low": START[None] - 0.1,
    "high": START[None] + 0.1,
    "inside": np.zeros(GRID.shape, bool),
    "values": np.zeros(GRID.shape),
    "v": np.zeros(2),
    "inputs": np.array([0]),
    "times": [0.0],
    "outcome": "reached",
}


def arrays_of(name, thing, seen, depth=0):
    """Every array, mapping and list within reach of public attributes and of what methods return: (name, thing)."""
    if isinstance(thing, np.ndarray):
        yield name, thing
    elif isinstance(thing, Mapping):
        yield name, thing
        for key in list(thing)[:20]:
            yield from arrays_of(f"{name}[{key!r}]", thing[key], seen, depth + 1)
    elif isinstance(thing, tuple | list) and not hasattr(thing, "_fields"):
        if isinstance(thing, list):
            yield name, thing
        for place, one in enumerate(thing[:4]):
            yield from arrays_of(f"{name}[{place}]", one, seen, depth + 1)
    elif type(thing).__module__.startswith("sdhj.") and id(thing) not in seen and depth < 6:
        seen[id(thing)] = thing
        for attribute in dir(type(thing)) + list(getattr(thing, "__dict__", ())):
            if attribute.startswith("_") or attribute in LEFT_OUT:
                continue
            yield from arrays_of(f"{name}.{attribute}", answer(thing, attribute), seen, depth + 1)


def answer(thing, attribute):
    """The value of an attribute, or what a method answers; None where it needs what is not known here."""
    try:
        found = getattr(thing, attribute)
        if not inspect.isroutine(found):
            return found
        needed = needs(getattr(found, "__func__", found), inspect.ismethod(found))
        if any(name not in ARGUMENTS for name in needed) or attribute in ("empty", "read", "of", "load"):
            return None
        copies = {name: np.copy(a) if isinstance(a := ARGUMENTS[name], np.ndarray) else a for name in needed}
        return found(**copies)
    except (ValueError, TypeError, AttributeError, NotImplementedError, sdhj.NotAdmissible, RuntimeError):
        return None


@cache
def needs(function, bound):
    """Names of a function's arguments that have no default, the first not among them where it is bound."""
    needed = [p.name for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    return needed[bound:]


def written_into(thing):
    """Whether a mapping or list lets itself be written."""
    try:
        if isinstance(thing, list):
            thing.append("written")
            thing.pop()
        else:
            thing["written"] = 1
            del thing["written"]
    except TypeError:
        return False
    return True


def says(table, tmp_path):
    """All that a table says: what a fresh controller answers, and the bytes of a file."""
    points = GRID.points()
    controller, rng = sdhj.Controller(table), np.random.default_rng(1)
    batch = controller.batch(points, 0)
    filtered = controller.filter(points, 0, wanted=rng.uniform(-0.5, 0.5, (len(points), 2)))
    table.save(tmp_path / "it.npz")
    loaded = sdhj.load(tmp_path / "it.npz")
    known = [batch.steps_to_go, batch.safe, batch.margins, batch.best, filtered.commands, table.contains(points)]
    known += [
        loaded.problem.inputs,
        table.problem.inputs,
        table.fraction(),
        table.problem.digest,
        loaded.problem.digest,
    ]
    return [np.array(one).tobytes() if isinstance(one, np.ndarray) else one for one in known]


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_nothing_that_is_handed_out_can_be_written_through(name, tmp_path):
    """All public attributes and methods of problem, table, controller, batch, report and trajectory are written to."""
    make, method = CASES[name]
    problem = make()
    table = sdhj.solve(problem, method, progress=False, play=False)
    controller = sdhj.Controller(table)
    before = says(table, tmp_path)
    batch = controller.batch(START[None], 0)
    report, trajectory = sdhj.monte_carlo(controller, runs=10, seed=0), sdhj.simulate(controller, START, seed=0)
    counts = str(report)
    written, seen, kept_open = 0, {}, []
    things = {"problem": problem, "table": table, "controller": controller, "report": report, "trajectory": trajectory}
    for title, thing in things.items():
        first, second = list(arrays_of(title, thing, seen)), dict(arrays_of(title, thing, {}))
        for place, array in first:
            if isinstance(array, Mapping | list):
                if written_into(array) and second.get(place) is array:
                    kept_open.append(place)
                continue
            if not array.flags.writeable or array.dtype == object:
                continue
            again = second.get(place) if array.size else None
            if again is not None and np.shares_memory(again, array):
                kept_open.append(place)
            array[...] = 1
            written += 1
    for array in batch:
        if isinstance(array, np.ndarray):
            array[...] = 1
    assert not kept_open, sorted({one.rsplit(".", 1)[-1] for one in kept_open})
    after = says(table, tmp_path)
    assert before == after and str(report) == counts and written > 10


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_what_is_kept_is_read_only(name):
    """Arrays in fields and cached properties, public ones and others, wherever a problem or table keeps them."""
    make, method = CASES[name]
    table = sdhj.solve(make(), method, progress=False, play=False)
    sdhj.Controller(table).batch(START[None], 0)
    seen, open_ones = {}, []

    def walk(place, thing, depth=0):
        if isinstance(thing, np.ndarray):
            if thing.flags.writeable and thing.size:
                open_ones.append(place)
        elif isinstance(thing, Mapping | tuple | list):
            each = thing.items() if isinstance(thing, Mapping) else enumerate(thing)
            for key, one in each:
                walk(f"{place}[{str(key)[:40]}]", one, depth + 1)
        elif type(thing).__module__.startswith("sdhj.") and id(thing) not in seen and depth < 12:
            seen[id(thing)] = thing
            for attribute, one in getattr(thing, "__dict__", {}).items():
                if attribute in ("terms", "_words"):  # made for the kernels alone; the store of words grows
                    continue
                walk(f"{place}.{attribute}", one, depth + 1)

    walk("table", table)
    assert not open_ones, open_ones


def test_what_was_given_may_change(rng):
    """What a problem was made of is copied: writing to it later changes nothing."""
    inputs, drift, gain, bounds = MOVES.copy(), MOVES.copy(), np.eye(2), np.array([0.03, 0.03])
    slope = np.ones((2, 2))
    given = sdhj.Dynamics(inputs, drift, gain, bounds)
    problem = problem_of(dynamics=given)
    boxed = problem_of(dynamics=sdhj.Dynamics(inputs, sdhj.BlackBox(lambda q, u: u - q, slope=slope, rate=0.0)))
    digest = problem.digest
    for array in (inputs, drift, gain, bounds, slope):
        array[...] = 7.0
    assert (
        problem.inputs.tolist() == MOVES.tolist() == given.drift.tolist() and given.gain.tolist() == np.eye(2).tolist()
    )
    assert problem_of(dynamics=given).digest == digest and (boxed.dynamics.drift.slope == 1.0).all()
    for array in (problem.inputs, given.inputs, given.drift, given.gain, given.bounds):
        with pytest.raises(ValueError, match="read-only"):
            array *= 0.9
    u = problem.inputs[1]
    with pytest.raises(ValueError, match="read-only"):
        u *= 0.9
    assert (u.copy() * 0.9).tolist() == (0.9 * MOVES[1]).tolist()


@pytest.mark.slow
def test_no_kernel_is_compiled_twice_for_what_may_be_written():
    """In a process of its own, as other tests call kernels by hand."""
    if numba.config.DISABLE_JIT:
        pytest.skip("nothing is compiled")
    here = [str(Path(__file__).parent), str(Path(zoo.__file__).parent)]
    code = f"import sys; sys.path[:0] = {here!r}; import test_read_only as it; print(it.twice())"
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True)
    assert done.stdout.splitlines()[-1:] == ["{}"], done.stdout + done.stderr


def twice():
    """Kernels with signatures that are one but for what may be written, after everything has been solved and asked."""
    for make, method in CASES.values():
        table = sdhj.solve(make(), method, progress=False)
        controller = sdhj.Controller(table)
        controller.batch(START[None], 0), controller.filter(START, 0, wanted=MOVES[1]), table.contains(START[None])
    modules, found = [module for name, module in sys.modules.items() if name.startswith("sdhj.kernels")], {}
    kernels = {id(one): one for module in modules for one in vars(module).values() if hasattr(one, "py_func")}
    for kernel in kernels.values():
        plain = [tuple(map(may_be_written, signature)) for signature in kernel.signatures]
        if len(plain) > len(set(plain)):
            found[kernel.py_func.__qualname__] = kernel.signatures
    return found


def may_be_written(kind):
    """A type of Numba's, with every array in it one that may be written."""
    if isinstance(kind, types.Array):
        return str(kind.dtype), kind.ndim, kind.layout
    if isinstance(kind, types.BaseTuple):
        return tuple(map(may_be_written, kind))
    return str(kind)


def test_a_sealed_mapping_refuses_all_writes_and_is_copied_as_it_is():
    table = sdhj.solve(problem_of(), progress=False, play=False)
    plain = {"outer": {"inner": 1}, "list": [1, [2], {"deep": [3]}], "pair": ([4], 5)}
    details = Sealed(plain)
    writes = (
        lambda one: one.update(a=1),
        lambda one: one.pop("outer"),
        lambda one: one.setdefault("a", 1),
        lambda one: one.clear(),
        lambda one: one.popitem(),
        lambda one: one.__ior__({"a": 1}),
        lambda one: one.__delitem__("outer"),
        lambda one: one["outer"].__setitem__("inner", 2),
        lambda one: one["list"].append(2),
        lambda one: one["list"].__setitem__(0, 2),
        lambda one: one["list"].__delitem__(0),
        lambda one: one["list"].__iadd__([2]),
        lambda one: one["list"].__imul__(2),
        lambda one: one["list"].insert(0, 2),
        lambda one: one["list"].remove(1),
        lambda one: one["list"].reverse(),
        lambda one: one["list"].sort(),
        lambda one: one["list"].pop(),
        lambda one: one["list"].clear(),
        lambda one: one["list"][1].extend([2]),
        lambda one: one["list"][2]["deep"].append(4),
        lambda one: one["pair"][0].append(4),
    )
    for write in writes:
        with pytest.raises(TypeError, match=r"read-only.*(dict|list)\(it\)"):
            write(details)
    for again in (pickle.loads(pickle.dumps(details)), copy.deepcopy(details), copy.copy(details)):
        assert again == details == plain and isinstance(again["outer"], Sealed)
        with pytest.raises(TypeError, match="read-only"):
            again["list"].append(2)
    assert type(details | {"a": 1}) is dict and json.loads(json.dumps(details)) == details | {"pair": [[4], 5]}
    for mapping in (table.details, table.problem.recipe, sdhj.arm_case_study(nodes=5).recipe["arguments"]):
        with pytest.raises(TypeError, match="read-only"):
            mapping["a"] = 1

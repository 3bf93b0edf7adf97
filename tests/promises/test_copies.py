"""What is pickled, copied or deep-copied answers as the original: problems, sets, methods, tables, controllers."""

import copy
import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from zoo import interval_problem, raft, torus_problem

import sdhj
from sdhj.problem.sets import ANYWHERE

SENT = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
    "old pickle": lambda thing: pickle.loads(pickle.dumps(thing, 2)),
}
each_way = pytest.mark.parametrize("send", SENT.values(), ids=SENT)


def sliding(*, ends="unsafe"):
    """It slides to the right at 1 m/s +- 0.2, whatever it does on the second axis."""
    far = sdhj.UnsafeSet((1,), lambda p, t: p[:, 0] + 2.0, name="far away")
    usual = {"nodes": [41, 9], "ends": [ends, "wall"], "gain": [[1.0], [0.0]], "bounds": [0.2]}
    return raft((-0.3, 0.0, 0.3), **usual, unsafe=[far], delta=0.1)


def black_boxed():
    one = interval_problem()
    return replace(one, target=sdhj.TargetSet((0,), sdhj.BlackBox(about_zero, rate=0.0)))


def about_zero(points, t):
    return np.abs(points[:, 0]) - 1.0


def leaving():
    """A safe end: who has left to the right is out of danger, and the games are played on a padded grid."""
    return sliding(ends=("unsafe", "safe"))


CASES = {
    "no target": (sliding, "hji"),
    "no target, certified": (sliding, sdhj.Certified(cells=[40, 4])),
    "a safe end": (leaving, "hji"),
    "a target": (interval_problem, "hji"),
    "a target, certified": (interval_problem, sdhj.Certified(cells=[80])),
    "a moving set": (lambda: torus_problem(steps=2), "lax"),
    "sensing": (lambda: replace(interval_problem(), sensing=sdhj.Sensing(error=0.01, delay=0.05)), "hji"),
    "a black box": (black_boxed, "hji"),
}
# every case by pickle, and two that hold most kinds of objects in the other ways too
PAIRS = [(case, "pickle") for case in CASES]
PAIRS += [(case, way) for case in ("a safe end", "a target, certified") for way in SENT if way != "pickle"]
each_case = pytest.mark.parametrize(
    ("case", "send"), [pytest.param(case, SENT[way], id=f"{case}-{way}") for case, way in PAIRS]
)


@cache
def solved(case):
    make, method = CASES[case]
    return sdhj.solve(make(), method, progress=False, play=False)


def states_of(problem, count=60):
    grid = problem.grid
    return np.random.default_rng(0).uniform(grid.lower, grid.upper, (count, grid.ndim))


def arrays_in(name, thing, seen):
    """Every array that an object holds, whatever holds it: (name, array)."""
    if isinstance(thing, np.ndarray):
        yield name, thing
    elif id(thing) not in seen:
        seen[id(thing)] = thing
        held = thing if isinstance(thing, dict) else vars(thing) if hasattr(thing, "__dict__") else {}
        held = dict(enumerate(thing)) if isinstance(thing, tuple | list) else held
        for key, one in held.items():
            if type(one).__module__.startswith(("sdhj", "builtins", "numpy")) and not callable(one):
                yield from arrays_in(f"{name}.{key}", one, seen)


def answers(table, rule="deepest", controller=None):
    """Everything that a table and its controller say of some states at the first and the last but one step."""
    controller, states = controller or sdhj.Controller(table, rule=rule), states_of(table.problem)
    found = []
    for step in (0, table.steps - 1):
        batch = controller.batch(states, step, first=True)
        found += [batch.steps_to_go, batch.safe, batch.margins, controller.choose(batch)]
        found += [table.contains(states, start=step), table.contains(states, start=step, within=0)]
        found += [controller.filter(states, step, np.zeros(len(states), int), first=True).inputs]
        found += [np.array([controller.fallback(one, step).steps for one in states[:10]])]
    return [*found, np.array([table.fraction(within=n) for n in range(table.steps + 1)])]


def assert_same(ours, theirs):
    for one, other in zip(ours, theirs, strict=True):
        np.testing.assert_array_equal(one, other)


@each_case
def test_a_problem_that_was_sent_promises_the_same(case, send):
    """Solved anew, with all that the first solve keeps in the problem; its parts are said to be equal."""
    problem, sent = solved(case).problem, send(solved(case).problem)
    assert sent.digest == problem.digest and sent == problem and hash(sent) == hash(problem)
    assert sent.has_no_target == problem.has_no_target == case.startswith(("no target", "a safe end"))
    again = sdhj.solve(sent, send(CASES[case][1]), progress=False, play=False)
    assert_same(answers(again), answers(solved(case)))


@each_case
def test_a_table_and_a_controller_that_were_sent_answer_the_same(case, send):
    table = solved(case)
    expected = answers(table)
    sent = send(table)
    assert_same(answers(sent), expected)
    assert_same(answers(sent, controller=send(sdhj.Controller(table))), expected)
    by_effort = sdhj.Controller(table, rule="effort")
    assert_same(answers(sent, rule="effort"), answers(table, controller=send(by_effort)))
    runs = [sdhj.monte_carlo(sdhj.Controller(one), runs=20, seed=0, progress=False) for one in (table, sent)]
    assert runs[0].counts == runs[1].counts


@each_case
def test_what_was_sent_cannot_be_written_either(case, send):
    """Which also keeps compiled code from being compiled again, for arrays of another kind."""
    table = solved(case)
    answers(table)
    kept = {name for name, one in arrays_in("table", table, {}) if not one.flags.writeable}
    sent = dict(arrays_in("table", send(table), {}))
    assert len(kept & set(sent)) > 5 and not [name for name in kept & set(sent) if sent[name].flags.writeable]


@each_way
def test_sets_and_their_formulas_that_were_sent_are_equal(send):
    problem = torus_problem()
    for part in (problem.target, *problem.unsafe):
        sent, points = send(part), np.random.default_rng(1).uniform(-3, 3, (50, 2))
        assert sent == part and hash(sent) == hash(part)
        np.testing.assert_array_equal(sent.level_set(points, 0.1), part.level_set(points, 0.1))
    assert send(ANYWHERE) is ANYWHERE and problem.target != problem.unsafe[0]
    assert replace(problem, delta=0.1) != problem != interval_problem()


def test_a_cost_to_go_that_was_sent_fits_the_table_it_is_of():
    """Sent apart from its table, too; and refuses that of another problem."""
    table, send = solved("a target"), SENT["pickle"]
    rule = sdhj.CostToGo(table, "effort", progress=False)
    expected = answers(table, controller=sdhj.Controller(table, rule=rule))
    assert_same(answers(table, controller=sdhj.Controller(table, rule=send(rule))), expected)
    assert_same(answers(table, controller=sdhj.Controller(send(table), rule=rule)), expected)
    other = sdhj.solve(interval_problem(disturbance=0.1), progress=False, play=False)
    with pytest.raises(ValueError, match="of another table"):
        sdhj.Controller(other, rule=send(rule)).select([-2.0], 0)


@each_way
def test_a_method_that_was_sent_is_equal(send):
    """What is equal solves the same."""
    for method in (sdhj.HJI(sdhj.Scheme(order=3)), sdhj.Projected([(0, 1)]), sdhj.HopfLax(), sdhj.Certified([9])):
        assert send(method) == method

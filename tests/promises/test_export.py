"""A certified table as C: it answers as Python does, bit for bit, and refuses whatever is not the file it was."""

import re
import shutil
import subprocess
import zlib
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import digest_cases
import forged_robots
import numpy as np
import pytest
import test_memory
import zoo
from parameters import but_slow
from refusals import drifting

import sdhj
from sdhj.certified import export as export_module
from sdhj.certified.check import verify
from sdhj.certified.export import FIELDS, STATUS, images_of
from sdhj.simulation.runs import admissible_states

pytestmark = pytest.mark.skipif(not shutil.which("gcc"), reason="there is no gcc")
STRICT = ["-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-pedantic", "-Werror"]
EVERY = ("steps_to_go", "select", "fallback", "filter", "filter_command", "safe_inputs", "clear_inputs")


def many_inputs():
    """A robot in the plane with 65 inputs, so that masks have nine bytes and words more than two numbers."""
    angles = np.arange(64) * 2 * np.pi / 64
    inputs = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(angles), np.sin(angles)], axis=1)]).round(3)
    return digest_cases.plane(*digest_cases.thin("nodes").unsafe[:1]), inputs


def lattice_inputs(side):
    """All velocities on a lattice of `side` by `side`: more than 256, which one byte would number."""
    speeds = np.linspace(-1, 1, side)
    return many_inputs()[0], np.stack(np.meshgrid(speeds, speeds), axis=-1).reshape(-1, 2)


def with_inputs(problem, inputs):
    dynamics = sdhj.Dynamics(inputs=inputs, drift=inputs, gain=np.eye(2), bounds=[0.05, 0.05])
    return replace(problem, dynamics=dynamics)


def senses():
    return replace(
        digest_cases.CASES["plane, sensing, certified"].problem(), sensing=sdhj.Sensing((0.02, 0.03), memory=False)
    )


def remembering(problem, error, **sensing):
    return replace(problem, sensing=sdhj.Sensing(error, memory=True, **sensing))


def oddly_named():
    names = ["*/ #error", "\u03b8 \\"]
    problem = zoo.torus_problem()
    return replace(problem, grid=replace(problem.grid, names=names), name='"a" /* b */')


CASES = {
    "line": (zoo.interval_problem, sdhj.Certified(cells=(80,))),
    "oddly named": (oddly_named, sdhj.Certified(cells=(30, 30))),
    "torus": (zoo.torus_problem, sdhj.Certified(cells=(40, 40), parts=4)),
    "moves": (lambda: digest_cases.tide(turning=True), sdhj.Certified(cells=(32, 24), parts=3)),
    "measured": (senses, sdhj.Certified(cells=(80, 60), parts=4)),
    "safe ends": (
        digest_cases.CASES["cart, safe ends, certified"].problem,
        digest_cases.CASES["cart, safe ends, certified"].method,
    ),
    "forbidden": (forged_robots.forbidden, sdhj.Certified(cells=(80,))),
    "drifting": (drifting, sdhj.Certified(cells=(80,))),  # out of its target, from where no input may lead back
    "standing": (forged_robots.standing, sdhj.Certified(cells=(40, 10), parts=2)),
    "car": (zoo.unicycle_problem, sdhj.Certified(cells=(30, 30, 38), parts=4)),
    "65 inputs": (lambda: with_inputs(*many_inputs()), sdhj.Certified(cells=(80, 60), parts=4)),
    "289 inputs": (lambda: with_inputs(*lattice_inputs(17)), sdhj.Certified(cells=(40, 30), parts=2)),
    "for ever": (
        lambda: digest_cases.cart(grid=sdhj.Grid([-1, -2], [1, 2], [25, 21]), steps=None),
        sdhj.Certified(cells=(40, 40), parts=4),
    ),
    "line, remembering": (lambda: remembering(zoo.interval_problem(), 0.05), sdhj.Certified(cells=(80,))),
    "joint, remembering": (lambda: test_memory.joint(0.02, jitter=0.001), sdhj.Certified(cells=(100, 100), parts=4)),
    "torus, remembering": (
        lambda: remembering(zoo.torus_problem(), 0.05),
        sdhj.Certified(cells=(30, 30), parts=3),
    ),
    "noisy, remembering": (forged_robots.noisy, sdhj.Certified(cells=(40, 10), parts=2)),
    "car, remembering": (
        lambda: remembering(zoo.unicycle_problem(), (0.01, 0.01, 0.02)),
        sdhj.Certified(cells=(30, 30, 38), parts=4),
    ),
    "tide, remembering": (
        lambda: remembering(digest_cases.tide(turning=True), 0.02),
        sdhj.Certified(cells=(32, 24), parts=3),
    ),
    "current, remembering": (lambda: remembering(forged_robots.tide(), 0.02), sdhj.Certified(cells=(120,), parts=2)),
    "arm": (digest_cases.CASES["arm, certified"].problem, sdhj.Certified(cells=(36, 36, 9, 9), parts=4)),
}
FINER = {
    "arm, remembering": (
        lambda: remembering(digest_cases.CASES["arm, certified"].problem(), 0.005),
        sdhj.Certified(cells=(36, 36, 9, 9), parts=4),
    ),
    "arm, finer": (digest_cases.CASES["arm, certified"].problem, digest_cases.CASES["arm, certified"].method),
}


@cache
def solved(name):
    problem, method = (CASES | FINER)[name]
    return sdhj.solve(problem(), method, progress=False, play=False)


def compiled_once():
    """Stands for `subprocess` where exports are compiled: their C is the same for all tables, and compiled once."""
    made = {}

    def run(command, **options):
        *flags, folder, source, _, library = command
        key = (*flags, Path(source).read_text(), Path(folder.removeprefix("-I"), "sdhj.h").read_text())
        if key not in made:
            subprocess.run(command, check=True)
            made[key] = Path(library).read_bytes()
        Path(library).write_bytes(made[key])
        return subprocess.CompletedProcess(command, 0)

    return SimpleNamespace(run=run)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    @cache
    def one(name, **options):
        return sdhj.export_c(solved(name), tmp_path_factory.mktemp("export"), progress=False, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export_module, "subprocess", compiled_once())
        yield one


def states_of(table, count, seed=0):
    """States anywhere, past the ends, on edges of cells within twice the slack, at seams, and laps away."""
    rng, grid = np.random.default_rng(seed), table.grid
    lower, upper = np.array(grid.lower), np.array(grid.upper)
    states = rng.uniform(lower - 0.02 * (upper - lower), upper + 0.02 * (upper - lower), (count, grid.ndim))
    on = np.stack([rng.choice(axis.edges(), count) for axis in table.axes], axis=1)
    beside = rng.choice([0.0, 0.1, 0.99, 1.0, 1.01, 1.9], states.shape) * table.proof.shell
    on += beside * rng.choice([-1.0, 1.0], states.shape)
    states = np.where(rng.random(states.shape) < 0.4, on, states)
    laps = rng.integers(-3, 4, states.shape) * np.where(grid.periodic, upper - lower, 0.0)
    return states + np.where(rng.random((count, 1)) < 0.2, laps, 0.0)


def assert_alike(table, c, states, step):
    """Steps, safe and clear inputs, the choice and the filter, bit for bit."""
    controller = sdhj.Controller(table)
    states_there = controller.predict(states, None, step)  # what errs is clipped to the grid
    batch = controller.batch(states_there, step, first=True)
    status, steps = c.steps_to_go(states, step, first=True)
    assert np.array_equal(status == 0, batch.steps_to_go >= 0)
    assert np.array_equal(steps[status == 0], batch.steps_to_go[status == 0])
    assert np.array_equal(c.safe_inputs(states, step, first=True)[1], batch.safe)
    status, chosen = c.select(states, step, first=True)
    assert np.array_equal(np.where(status == 0, chosen, -1), controller.choose(batch))
    if step == table.steps:
        assert (status < 0).all()
        return
    assert np.array_equal(c.clear_inputs(states, step)[1], table.hazards(states_there, step) <= 0.0)
    status, away = c.fallback(states, step)
    clear = c.clear_inputs(states, step)[1]
    assert (
        np.array_equal(status == 0, clear.any(axis=1)) and clear[np.flatnonzero(status == 0), away[status == 0]].all()
    )
    if not table.problem.time_invariant or step == 0:
        rng = np.random.default_rng(step)
        wanted = rng.integers(0, len(table.problem.inputs), len(states))
        commands = table.problem.inputs[wanted] + rng.normal(0.0, 0.3, table.problem.inputs[wanted].shape).round(1)
        for what, asked in (("filter", wanted), ("filter_command", commands)):
            told = controller.filter(states_there, step, asked, first=True)
            status, chosen = c.ask(what, states, step, asked, first=True)
            assert np.array_equal(status == 0, told.promised)
            assert np.array_equal(chosen[status == 0], told.inputs[told.promised])


LONG = ["arm", "car", "car, remembering", "65 inputs", "289 inputs", "moves", "oddly named", "measured", "standing"]
LONG += ["tide, remembering", "torus, remembering"]


@pytest.mark.parametrize("name", but_slow(CASES, *LONG))
def test_c_answers_as_python_does(exported, name):
    table, c = solved(name), exported(name)
    assert c.selftest() == 0
    for step in {0} if table.problem.time_invariant else {0, 1, table.steps - 1, table.steps}:
        assert_alike(table, c, states_of(table, 4000 if name == "arm" else 2000), step)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*CASES, *FINER])
def test_c_answers_as_python_does_in_a_million_states(exported, name):
    table, c = solved(name), exported(name)
    for seed in range(100):
        assert_alike(
            table, c, states_of(table, 10_000, seed + 1), 0 if table.problem.time_invariant else seed % table.steps
        )


@pytest.mark.slow
def test_a_thousand_inputs_are_solved_certified_verified_and_exported(tmp_path):
    """32 x 32 inputs: the file is proved, C answers alike, and inputs past the 256th are chosen."""
    problem = with_inputs(*lattice_inputs(32))
    table = sdhj.solve(problem, sdhj.Certified(cells=(24, 18), parts=2), progress=False)
    table.save(tmp_path / "table.npz")
    assert verify(tmp_path / "table.npz", progress=False).ok
    c = sdhj.export_c(table, tmp_path / "c", progress=False)
    assert_alike(table, c, states_of(table, 300), 0)
    controller = sdhj.Controller(sdhj.solve(problem, progress=False))
    chosen = controller.batch(admissible_states(controller, 1000, np.random.default_rng(0)), 0).best
    assert chosen.min() >= 0 and chosen.max() > 255


ARM = "arm, remembering"
REMEMBERING = [name for name in CASES if name.endswith("remembering")]


@pytest.mark.parametrize("name", but_slow([*REMEMBERING, ARM], ARM, "car, remembering", "tide, remembering"))
def test_a_loop_in_c_carries_on_what_python_carries_on(exported, name):
    """The same inputs and the same points, bit for bit, of a crowd of which nobody cares where it is led.

    The states jump: by nothing, by errors, to where nothing led, laps away, off the grid.
    """
    table, c, rng = solved(name), exported(name), np.random.default_rng(0)
    controller, count, problem = sdhj.Controller(table), 400, table.problem
    states = states_of(table, 4 * count)
    states = np.concatenate([states[table.contains(states)], states])[:count]
    error, low, high = (
        np.broadcast_to(problem.sensing.error, states.shape[1:]),
        *np.array([problem.grid.lower, problem.grid.upper]),
    )
    loop, known, inputs, earlier, told = c.loop(count), None, None, 0, 0
    for step in range(min(table.steps, 8) if not problem.time_invariant else 8):
        at = 0 if problem.time_invariant else step
        measured = states + rng.choice([-1.0, 0.3, 1.0], states.shape) * error
        seen = controller.predict(measured, None, at)
        wanted = rng.integers(0, len(problem.inputs), count) if step % 2 else None
        status, chosen, points, missed = loop.step(measured, at, wanted)
        if known is not None:
            seen, lost = table.next_points(known, inputs, earlier, seen)
            assert np.array_equal(missed, lost)
            told += int(lost.sum())
        assert np.array_equal(points, seen)
        if wanted is None:
            ours = controller.choose(table.batch(seen, at))
            assert np.array_equal(ours[status == 0], chosen[status == 0]) and not (ours[status < 0] >= 0).any()
        else:
            answer = controller.filter(seen, at, wanted, first=True)  # which are carried on here
            assert np.array_equal(status == 0, answer.promised)
            assert np.array_equal(answer.inputs[status == 0], chosen[status == 0])
        known, inputs, earlier = seen, chosen, at
        moves = problem.interval(at).displacements(states)
        states = states + moves[np.arange(count) if len(moves) > 1 else 0, inputs]
        thrown, laps = rng.random((2, count, 1)) < 0.05
        states = np.where(thrown, rng.uniform(low - 0.1, high + 0.1, states.shape), states)
        states += laps * rng.integers(-2, 3, states.shape) * np.where(problem.grid.periodic, high - low, 0.0)
    assert told


def test_a_command_for_fewer_robots_is_refused(exported):
    loop = exported("torus, remembering").loop(3)
    with pytest.raises(ValueError, match="wanted must have shape"):
        loop.step(np.zeros((3, 2)), 0, [0])


def test_c_refuses_a_measurement_by_itself(exported):
    """As Python does: what is proved for one interval is answered, and a first measurement that is said to be one."""
    c, table = exported("joint, remembering"), solved("joint, remembering")
    controller, states = sdhj.Controller(table), states_of(table, 200)
    for what in EVERY:
        status, found = c.ask(what, states)
        if what in ("fallback", "clear_inputs"):
            assert (status == 0).any() and (status != STATUS["NOT_CARRIED"]).all()
            continue
        assert (status == STATUS["NOT_CARRIED"]).all(), what
        if what in ("select", "filter", "filter_command"):
            assert (found == controller.problem.inputs[:, 0].tolist().index(0.0)).all()  # the braking one
        assert (c.ask(what, states, first=True)[0] == 0).any() and c.selftest() == 0
    for ask in (lambda: controller.batch(states), lambda: controller.filter(states, 0, np.zeros(200, int))):
        with pytest.raises(ValueError, match="a prediction by itself"):
            ask()
    for what in EVERY:  # nobody remembers
        assert (exported("line").ask(what, [[-2.1]])[0] == 0).all()


def test_what_the_parts_of_a_loop_say_of_a_first_measurement(exported):
    """In C a first measurement is that of a memory that is new, and no place is made of counts."""
    c, table = exported("joint, remembering"), solved("joint, remembering")
    source = c.folder / "parts.c"
    source.write_text("""
#include "sdhj.h"
#include "sdhj_robot.h"
#include <stdio.h>
int main(int argc, char **argv) {
  static unsigned char bytes[1 << 22]; sdhj_table t; sdhj_memory memory = {0}; sdhj_place place;
  FILE *file = fopen(argv[argc - 1], "rb");
  size_t size = fread(bytes, 1, sizeof bytes, file);
  const double q[2] = {0.3, 0.1};
  const uint32_t cell[2] = {50, 50};
  uint32_t input, again;
  int told[4];
  fclose(file);
  if (sdhj_open(&t, bytes, size, sdhj_robot_digest) != SDHJ_OK) return 1;
  told[0] = (int)sdhj_select(&t, 0, q, &input), told[1] = (int)sdhj_cell(&t, cell, &place);
  if (sdhj_remember(&t, &memory, q, &place) != SDHJ_OK) return 2;
  told[2] = (int)sdhj_select_at(&t, 0, &place, &input);
  memset(&memory, 0, sizeof memory);
  told[3] = (int)sdhj_step(&t, &memory, 0, q, &again);
  printf("%d %d %d %u %d %u", told[0], told[1], told[2], (unsigned)input, told[3], (unsigned)again);
  return 0;
}
""")
    program = c.folder / "parts"
    subprocess.run(["gcc", "-std=c99", *STRICT, f"-I{c.folder}", str(source), "-o", str(program)], check=True)
    told = subprocess.run([str(program), str(c.folder / "sdhj_table.bin")], capture_output=True, check=True).stdout
    chosen = sdhj.Controller(table).select([0.3, 0.1], first=True)
    assert told.split() == [b"-9", b"-9", b"0", b"%d" % chosen, b"0", b"%d" % chosen]


@pytest.mark.slow
def test_nobody_whom_c_remembers_is_lost(exported):
    """A joint at 50 Hz, 200 runs for 4 s pushed towards its stop, errors at their most: none lost, none without."""
    table, rng = solved("joint, remembering"), np.random.default_rng(1)
    q = rng.uniform([-1, -2], [1, 2], (5000, 2))
    states = q[table.contains(q)][:200]
    loops = (
        exported("joint, remembering", only=("filter",)).loop(200),
        exported("joint, remembering", only=("select",)).loop(200),
    )
    for loop, wanted in zip(loops, (np.full(200, 4), None), strict=True):
        own = states.copy()
        for _ in range(200):
            status, inputs, points, missed = loop.step(test_memory.measured(own, rng), 0, wanted)
            assert (status == 0).all() and not missed.any()
            assert (np.abs(points - own) <= test_memory.ERROR + 1e-12).all()
            own, hit = test_memory.moved(own, test_memory.LEVELS[inputs, 0], 0.02, rng)
            assert not hit.any()
        assert wanted is None or own[:, 0].max() > 0.9


def test_what_begins_anew_in_c_is_told(exported):
    c = exported("joint, remembering")
    loop = c.loop(3)
    states = np.array([[0.5, 0.1], [0.0, 0.0], [np.nan, 0.0]])
    assert loop.step(states)[0].tolist() == [0, 0, -4]
    states[0, 0] -= 0.3  # somebody has pushed it
    states[2, 0] = 0.0
    status, _, points, missed = loop.step(states)
    assert missed.tolist() == [True, False, True] and status.tolist() == [0, 0, 0]
    assert np.array_equal(points[::2], states[::2])
    assert not loop.step(points)[3].any()


def test_images_make_a_file_larger_by_what_is_said(exported):
    """4 bytes an axis, an input and a cell of the axes that images depend on."""
    table, c = solved("joint, remembering"), exported("joint, remembering")
    assert c.data[8] == 2 and int.from_bytes(c.data[80:84], "little") == 1
    _, reads, images = images_of(table)
    assert reads == [2, 2] and sum(one.nbytes for one in images) == 4 * 2 * 5 * table.shape[1]
    assert b"".join(one.tobytes() for one in images) in c.data
    assert exported("torus").data[8] == 1 and exported("torus").data[80:84] == bytes(4)  # as it was before


@pytest.mark.parametrize("rule", but_slow(["effort", "target", "clearance"], "effort"))
def test_built_in_rules(exported, rule):
    table, c = solved("torus"), exported("torus", rule=rule)
    controller, states = sdhj.Controller(table, rule=rule), states_of(table, 2000)
    status, chosen = c.select(states)
    assert np.array_equal(np.where(status == 0, chosen, -1), controller.choose(controller.batch(states, 0)))


@pytest.mark.parametrize("only", [("select",), ("steps",), ("filter", "safe")])
def test_what_is_left_out_is_said(exported, only):
    table, c = solved("torus"), exported("torus", only=only)
    assert c.selftest() == 0 and c.nbytes < exported("torus").nbytes
    states = states_of(table, 500)
    for what, field in zip(EVERY, ("steps", "select", "clear", "filter", "filter", "safe", "clear"), strict=True):
        status, _ = c.ask(what, states)
        assert ((status == STATUS["LEFT_OUT"]).any() or (status < 0).all()) == (field not in only), what
    if only == ("select",):  # on an edge a cell may answer that is more steps away
        states = np.random.default_rng(0).uniform(table.grid.lower, table.grid.upper, (500, 2))
        status, chosen = c.select(states)
        _, proved = exported("torus").safe_inputs(states)
        inside = np.flatnonzero(status == 0)
        assert inside.size > 50 and proved[inside, chosen[inside]].all()
        often = proved.sum(axis=0)  # by chance two may seem in another order than they are in all cells
        assert (often[chosen[inside]] > 0.6 * (often * proved[inside]).max(axis=1)).all()


def test_states_that_are_none_have_a_status_and_the_braking_input(exported):
    c = exported("safe ends", brake=1)
    table = solved("safe ends")
    low, high = np.array(table.grid.lower), np.array(table.grid.upper)
    middle = (low + high) / 2
    for axis, value in ((0, np.nan), (1, np.inf), (0, -np.inf)):
        q = middle.copy()
        q[axis] = value
        status, chosen = c.select(q)
        assert status[0] == -4 and chosen[0] == 1
    past = middle.copy()
    past[0] = low[0] - 0.1  # a safe end
    assert c.select(past)[0][0] == STATUS["PAST_SAFE_END"] and c.select(past)[1][0] == 1
    past[0] = high[0] + 0.1
    assert c.select(past)[0][0] == STATUS["OFF_GRID"]
    past[0], past[1] = low[0] - 0.1, high[1] + 9.0  # two ends, of which one is not safe
    assert c.select(past)[0][0] == STATUS["OFF_GRID"]


def test_goals_need_no_input(exported):
    table, c = solved("drifting"), exported("drifting")
    states = states_of(table, 5000)
    arrived = c.steps_to_go(states)[1] == 0
    status, _ = c.select(states[arrived])
    assert set(status.tolist()) == {0, STATUS["IN_TARGET"]}
    assert np.array_equal(status == 0, c.safe_inputs(states[arrived])[1].any(axis=1))


# ---- files that are not what they were


def refusals(folder, files, digest="NULL"):
    """How many of some files sdhj_open takes, by a program that reads them from a list."""
    source = folder / "open.c"
    source.write_text("""
#include "sdhj.h"
#include <stdio.h>
#include <stdlib.h>
int main(void) {
  static unsigned char bytes[1 << 22];
  unsigned long size, taken = 0, seen = 0;
  while (scanf("%lu", &size) == 1) {
    sdhj_table t; unsigned char *own; uint32_t input; double q[6] = {0.1, 0.1, 0.1, 0.1, 0.1, 0.1};
    if (getchar() != 10 || fread(bytes, 1, size, stdin) != size) return 2;
    own = (unsigned char *)malloc(size ? size : 1); memcpy(own, bytes, size); seen++;
    if (sdhj_open(&t, own, size, NULL) == SDHJ_OK) {
      sdhj_memory memory = {0}; uint32_t step;
      taken++; sdhj_select(&t, 0, q, &input); sdhj_selftest(&t);
      for (step = 0; step < 9; step++) sdhj_step(&t, &memory, step, q, &input);
    }
    free(own);
  }
  printf("%lu %lu", seen, taken);
  return 0;
}
""")
    program = folder / "open"
    if not program.exists():
        flags = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-O1"]
        subprocess.run(["gcc", "-std=c99", *flags, f"-I{folder}", str(source), "-o", str(program)], check=True)
    data = b"".join(b"%d\n" % len(one) + one for one in files)
    told = subprocess.run([str(program)], input=data, capture_output=True, check=True)
    return [int(word) for word in told.stdout.split()]


def damaged(data, rng, count):
    for _ in range(count):
        bad = bytearray(data)
        kind = rng.integers(0, 4)
        if kind == 0:
            bad[int(rng.integers(0, len(bad)))] ^= 1 << int(rng.integers(0, 8))
        elif kind == 1:
            at = int(rng.integers(0, len(bad) - 8))
            bad[at : at + 8] = rng.integers(0, 256, 8, np.uint8).tobytes()
        elif kind == 2:
            del bad[int(rng.integers(0, len(bad))) :]
        else:
            bad[0:600] = bytes(bad[0:600][: int(rng.integers(0, 600))]).ljust(600, b"\1")
        yield bytes(bad) if bytes(bad) != data else data[:-1]


@pytest.mark.slow
def test_damaged_and_truncated_files_are_refused(exported):
    c, rng, count = exported("torus"), np.random.default_rng(0), 10_000
    assert refusals(c.folder, [c.data]) == [1, 1]
    assert refusals(c.folder, list(damaged(c.data, rng, count))) == [count, 0]
    for at in range(560):  # every byte of the head
        assert (
            refusals(c.folder, [c.data[:at] + bytes([c.data[at] ^ 1]) + c.data[at + 1 :]]) == [1, 0]
            if at % 40 == 0
            else 1
        )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "count"), [("torus", 1500), ("tide, remembering", 300), ("noisy, remembering", 300)])
def test_numbers_that_lie_are_refused_or_harmless_although_the_checksum_fits(exported, name, count):
    """Whoever writes a checksum of his own may get wrong answers, but reads no byte that is not of the table."""
    c, rng, files = exported(name), np.random.default_rng(1), []
    for _ in range(count):
        bad = bytearray(c.data)
        at = int(rng.choice([rng.integers(16, 96), rng.integers(160, 560), rng.integers(560, len(bad) - 4)]))
        bad[at : at + 4] = rng.choice([rng.integers(0, 256, 4, np.uint8), np.array([255] * 4, np.uint8)]).tobytes()
        bad[12:16] = zlib.crc32(bytes(bad[:12] + bad[16:])).to_bytes(4, "little")
        files.append(bytes(bad))
    seen, _ = refusals(c.folder, files)  # under sanitizers, which end the program
    assert seen == count


def test_the_table_of_another_robot_is_refused(exported):
    c, other = exported("torus"), exported("line")
    source = other.folder / "other.c"
    source.write_text("""
#include "sdhj.h"
#include "sdhj_robot.h"
#include <stdio.h>
int main(int argc, char **argv) {
  static unsigned char bytes[1 << 22]; sdhj_table t; FILE *file = fopen(argv[argc - 1], "rb");
  size_t size = fread(bytes, 1, sizeof bytes, file);
  printf("%d", (int)sdhj_open(&t, bytes, size, sdhj_robot_digest)); fclose(file);
  return 0;
}
""")
    program = other.folder / "other"
    subprocess.run(["gcc", "-std=c99", *STRICT, f"-I{other.folder}", str(source), "-o", str(program)], check=True)
    told = [
        subprocess.run([str(program), str(one.folder / "sdhj_table.bin")], capture_output=True) for one in (other, c)
    ]
    assert [one.stdout for one in told] == [b"0", b"-6"]


PROGRAM = """
#include "sdhj.h"
#include "sdhj_robot.h"
int main(void) {
  sdhj_table t; uint32_t input, cell[6] = {0, 0, 0, 0, 0, 0}; uint8_t bits[SDHJ_ROBOT_MASK_BYTES]; sdhj_place place;
  if (sdhj_open(&t, NULL, 0, sdhj_robot_digest) != SDHJ_OK) return 0;
  sdhj_cell(&t, cell, &place);
  input = SDHJ_ROBOT_BRAKE + SDHJ_ROBOT_TIMELESS + SDHJ_ROBOT_REMEMBERS + SDHJ_ROBOT_BYTES;
  return (int)sdhj_select_at(&t, 0, &place, &input) + (int)sdhj_safe_inputs_at(&t, 0, &place, bits);
}
"""


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["gcc", "g++", "clang", "clang++"])
@pytest.mark.parametrize("name", ["torus", "oddly named"])
def test_compilers_find_nothing_to_say(exported, compiler, name):
    if not shutil.which(compiler):
        pytest.skip(f"there is no {compiler}")
    folder = exported(name).folder
    plus = compiler.endswith("++")
    kinds = ["-x", "c++", "-std=c++11"] if plus else ["-std=c99"]
    for more in ([], ["-DSDHJ_NO_FLOAT"], ["-O3"], ["-std=c++20"] if plus else ["-std=c11"]):
        command = [compiler, *kinds, *STRICT, *more, f"-I{folder}", "-c", "-", "-o", str(folder / "program.o")]
        command[1:1] = [] if "++" in compiler else ["-x", "c"]
        subprocess.run(command, input=PROGRAM.encode(), check=True)


@pytest.mark.slow
def test_fused_multiply_adds_change_nothing(exported, monkeypatch):
    monkeypatch.setattr(export_module, "FLAGS", ("-std=gnu99", "-O3", "-march=native", "-shared", "-fPIC"))
    table = solved("car")
    c = sdhj.certified.export.Exported(exported("car").folder, table)
    assert_alike(table, c, states_of(table, 2000), 0)


# ---- what is refused


def test_what_cannot_be_exported_is_refused_in_a_line(tmp_path):
    late = sdhj.solve(
        digest_cases.CASES["plane, sensing, certified"].problem(), sdhj.Certified(cells=(40, 30), parts=3), play=False
    )
    with pytest.raises(ValueError, match="delay is not exported"):
        sdhj.export_c(late, tmp_path)
    table = solved("torus")
    for options, sentence in (
        ({"rule": "best"}, "rule "),
        ({"only": ("speed",)}, "only "),
        ({"only": ()}, "only"),
        ({"brake": 99}, "brake"),
    ):
        with pytest.raises(ValueError, match=sentence):
            sdhj.export_c(table, tmp_path, **options)
    assert not list(tmp_path.iterdir())


def test_the_header_of_a_robot_says_what_it_is(exported):
    table, c = solved("torus"), exported("torus")
    text = (c.folder / "sdhj_robot.h").read_text()
    assert f"#define SDHJ_ROBOT_STEPS {table.steps}" in text and table.problem.digest in text
    rows = re.findall(r"\{(-?[0-9.e+-]+(?:, -?[0-9.e+-]+)*)\},", text)
    assert np.array_equal([[float(x) for x in row.split(", ")] for row in rows], table.problem.inputs)
    assert all(field in text for field in FIELDS)

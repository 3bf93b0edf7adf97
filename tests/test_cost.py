"""What a solve costs: stated before it begins, told while it runs, refused where it is too much."""

import os
import subprocess
import sys
import textwrap
import warnings
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

import sdhj
from sdhj.problem.cost import CALL, Meter
from sdhj.problem.findings import ResolutionWarning
from sdhj.solver import games, recursion, schemes
from sdhj.solving import method_of

MOVES = 0.5 * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1.0]])


def disk(x, y, radius):
    return lambda p, t: np.hypot(p[:, 0] - x, p[:, 1] - y) - radius


def plane(delta=0.25, steps=2, turning=False, timed=False, moving=False, nodes=21, **options):
    """A robot in the plane, around a post, whose drift may read the state and the time."""
    drift = MOVES
    if turning:
        drift = lambda q, u: np.stack([u[0] - 0.2 * q[:, 1], u[1] + 0.2 * q[:, 0]], axis=1)  # noqa: E731
    if timed:
        drift = lambda q, u, t: np.stack([u[0] - 0.2 * q[:, 1] + 0.1 * np.sin(t), u[1] + 0.2 * q[:, 0]], axis=1)  # noqa: E731
    post = (lambda p, t: np.hypot(p[:, 0] - 0.1 * t, p[:, 1]) - 0.4) if moving else disk(0.0, 0.0, 0.4)
    return sdhj.ReachAvoidProblem(
        sdhj.Grid([-2, -2], [2, 2], [nodes, nodes]),
        sdhj.Dynamics(MOVES, drift, np.eye(2), options.pop("bounds", [0.1, 0.1])),
        sdhj.TargetSet((0, 1), disk(0.9, 0.7, 0.6)),
        [sdhj.UnsafeSet((0, 1), post, name="post")],
        delta,
        steps,
        **options,
    )


FIXED = sdhj.HJI(sdhj.Scheme(frame="fixed"))


@pytest.fixture
def done(monkeypatch):
    """Counts of the updates of nodes and of the calls of the kernel, where it is called, by what it is given."""
    counts, kernel = Counter(), schemes.stage

    def counted(phi, out, wall, velocities, order, flux, layout, step):
        counts.update(updates=phi.shape[0] * layout.near.shape[0] * layout.rows * layout.nodes, calls=1)
        return kernel(phi, out, wall, velocities, order, flux, layout, step)

    monkeypatch.setattr(schemes, "stage", counted)
    return counts


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::sdhj.problem.findings.ProjectionWarning")
@pytest.mark.parametrize("kind", ["constant", "turning", "timed", "moving"])
@pytest.mark.parametrize("method", [FIXED, sdhj.Projected(inner=FIXED), sdhj.HJI(games="joint")])  # no shifts
def test_updates_of_nodes_are_those_that_were_stated(done, kind, method):
    """Less the tubes that are shared."""
    problem = plane(**{kind: True} if kind != "constant" else {}, steps=3)
    stated = sdhj.estimate(problem, method)
    assert not done  # nothing is solved
    table = sdhj.solve(problem, method, progress=False, play=False)
    solved = stated.tubes - table.details["tubes_shared"]
    each = (stated.operations - stated.once) / stated.tubes - len(problem.inputs) * problem.grid.size
    assert stated.once + solved * each == pytest.approx(done["updates"] + done["calls"] * CALL, rel=1e-6)


@pytest.mark.parametrize("bounds", [[0.1, 0.1], [0.9, 1.7]], ids=["below a cell", "some cells"])
def test_cost_of_the_moving_frame_is_that_of_one_equation_and_a_shift_for_each_input(done, bounds):
    """The shifts as four looks at nodes each, a quarter apiece.

    Along the first axis the five inputs have three shifts, along the second five; the maximum over what the disturbance
    reaches, if that is a cell or more, looks at the nodes between its ends too.
    """
    problem = replace(plane(steps=3, bounds=bounds), unsafe=())
    stated = sdhj.estimate(problem)
    table = sdhj.solve(problem, progress=False, play=False)
    solved = stated.tubes - table.details["tubes_shared"]
    each = (stated.operations - stated.once) / stated.tubes - len(problem.inputs) * problem.grid.size
    used = games.HJIGames(problem.padded, schemes.Scheme())
    cells = 0.25 * np.array(bounds) / problem.grid.spacing  # that the disturbance pushes, to either side
    reached = sum(4 + 2 * c if c >= 1 else 4 for c in cells) if (cells >= 1).any() else 0
    looks = solved * used.moving_grid[0].size * (4 * (3 + 5) + reached)
    assert used.shifted and done["updates"] > 0
    assert stated.once + solved * each == pytest.approx(done["updates"] + done["calls"] * CALL + looks / 4, rel=1e-3)


@pytest.mark.parametrize("moving", [False, True])
def test_a_set_that_moves_is_said_to_cost_a_triangle_of_tubes(moving):
    problem = plane(steps=8, moving=moving)
    stated = sdhj.estimate(problem)
    assert stated.tubes == (8 * 9 // 2 if moving else 8)
    assert (" (N (N + 1) / 2 in place of N = 8, because 'post' depends on time)" in str(stated)) == moving


@pytest.mark.filterwarnings("ignore::sdhj.problem.findings.ResolutionWarning")
@pytest.mark.parametrize("name", ["lax", "hji", "projected", "certified"])
def test_what_takes_too_long_is_refused_with_the_number_that_makes_it_so(name, tmp_path):
    """Before anything is solved; the advice to allow more is followed."""
    method = sdhj.Certified([20, 20]) if name == "certified" else name
    slip, meant = (plane(delta, turning=name != "lax") for delta in (250.0, 0.25))
    stated, fine = sdhj.estimate(slip, method), sdhj.estimate(meant, method)
    # the fastest crosses .6 m/s x 250 s / .2 m along one axis, more along both or where it turns
    assert 700 <= stated.crossed <= 6000
    assert stated.operations > (0.99 if name == "certified" else 200) * fine.operations
    stores = [None, tmp_path / "table"] if name in ("lax", "hji") else [None]
    for store in stores:
        with pytest.raises(ValueError, match=r"the state crosses up to [\d,]+ cells.*delta.*operations=") as refused:
            sdhj.solve(slip, method, store=store, operations=stated.operations / 2)
        assert f"{stated.crossed:,.0f} cells" in str(refused.value)
        assert not (tmp_path / "table").exists()
        allowed = float(str(refused.value).rpartition("operations=")[2].rstrip(")"))
        assert sdhj.estimate(slip, method).operations <= allowed
    assert sdhj.solve(meant, method, operations=1.1 * fine.operations, play=False).steps == 2


def test_operations_are_a_number_above_0():
    for wrong in (0, -1, "many", float("nan")):
        with pytest.raises(ValueError, match="operations must be"):
            sdhj.solve(plane(), operations=wrong)


def test_what_crosses_all_axes_in_an_interval_is_told():
    with pytest.warns(ResolutionWarning, match=r"interval of 250 s the state crosses up to [\d,]+ cells.*units"):
        sdhj.estimate(plane(250.0, turning=True))
    with warnings.catch_warnings(action="error"):
        sdhj.estimate(plane(0.25, turning=True))


class Told(Meter):
    """A meter whose bar is a list of how far it has come."""

    def begin(self, stated, endless):
        super().begin(stated, endless)
        self.seen, self.bar.update = [], lambda more: self.seen.append(more)


@pytest.mark.parametrize("method", ["hji", "lax"])
def test_the_bar_moves_within_an_interval_and_ends_where_it_was_said(method):
    with Told(method, True) as meter:
        sets = method_of(method).sets(plane(2.0, steps=2))
        before = len(meter.seen)
        assert before > 5  # within the avoid game alone
        meter.tube()
        for within in (1, 2):
            if within == 1:
                sets.write_goal(0)
            sets.extend(0, within)
            meter.tube()
    assert max(meter.seen) < meter.cost.operations / 3
    assert sum(meter.seen) + meter.operations_per_tube == pytest.approx(
        meter.cost.operations + meter.operations_per_tube, rel=1e-6
    )


MEASURED = """
    import sys
    sys.path[:0] = {paths!r}
    import sdhj
    from test_cost import plane

    def told(key):
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) * 1024 for line in status if line.startswith(key))

    sdhj.solve(plane(.1, 1, timed=True, bounds={bounds}), play=False, progress=False)  # compiles
    problem = plane(.1, {steps}, timed=True, nodes=90, bounds={bounds})
    stated, before = sdhj.estimate(problem).nbytes, told("VmRSS")
    with open("/proc/self/clear_refs", "w") as refs:
        refs.write("5")  # the peak is counted anew
    table = sdhj.solve(problem, play=False, progress=False)
    print(stated, told("VmHWM") - before, table.nbytes)
"""


@pytest.mark.slow
@pytest.mark.skipif(not os.access("/proc/self/clear_refs", os.W_OK), reason="the peak is asked of Linux")
@pytest.mark.parametrize("bounds", ["[.1, .1]", pytest.param("lambda t: [.1 + .01 * t, .1]", marks=pytest.mark.slow)])
def test_memory_does_not_grow_with_steps_beyond_the_table(bounds):
    """Of dynamics that depend on time; and what is stated beyond the process holds within 1.3."""
    found = []
    for steps in (2, 10):
        code = MEASURED.format(paths=[os.path.dirname(__file__)], steps=steps, bounds=bounds)
        done = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True)
        stated, peak, table = map(int, done.stdout.split())
        assert peak < 1.3 * (stated - recursion.PROCESS)
        found.append(peak - table)
    assert found[1] - found[0] < 8e6  # before: some 20 MB a step


def test_velocities_are_kept_of_one_interval_and_up_to_a_limit(monkeypatch):
    monkeypatch.setattr(games, "KEPT", 60_000)
    problem = plane(timed=True)
    solver = games.HJIGames(problem, sdhj.Scheme())
    field, taus = solver.velocities(1, (0, 1), 0), np.linspace(0.0, 0.2, 20).tolist()
    first = [field(tau) for tau in taus]
    again = [field(tau) for tau in taus]
    kept = sum(one is other for one, other in zip(first, again, strict=True))
    each = schemes.arranged_bytes(problem.grid, sdhj.Scheme()) + first[0].nbytes
    assert kept == 60_000 // each > 1
    solver.velocities(1, (0, 1), 1)(0.0)
    assert len(solver._fields) == 1  # those of the step before are gone


def test_the_ends_of_an_axis_are_counted_as_wide_as_an_interval_leads():
    grid = sdhj.Grid([-1.0], [1.0], [41], ends=["unsafe"])
    still, fast = (
        sdhj.ReachAvoidProblem(grid, sdhj.Dynamics([[0.0]], [[v]], [[1.0]], [0.1]), None, [], 1.0, 2)
        for v in (0.0, 500.0)
    )
    assert recursion.memory_needed(fast) - recursion.memory_needed(still) > 20_000 * 4 * 12

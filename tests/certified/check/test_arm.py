"""Small tables of arms and their exports, verified by the checker as plain Python, and lies of each kind in them.

A twin says what is claimed, and which lies are surely false: the cells that an interval leads to in fractions, what
touches by samples, all else by loops.
"""

import itertools
import json
import math
import re
from collections import Counter
from copy import copy
from fractions import Fraction
from functools import cache
from types import SimpleNamespace

import make_arms
import naive_certified as naive
import numpy as np
import pytest
from forging import replaced
from naive_certified import CIRCLE, STILL

from sdhj.certified.check import verify
from sdhj.certified.check.arm import claims as arm_claims
from sdhj.certified.check.arm import separation
from sdhj.certified.check.arm.claims import PI, Arm, cells_added
from sdhj.certified.check.arm.exported import claims as claims_of_export
from sdhj.certified.check.reading import head_and_arrays
from sdhj.certified.check.sampled import InMemory
from sdhj.certified.check.words import ARRIVED, FIELDS, NO_INPUT, UNPROVED, Words

pytestmark = pytest.mark.usefixtures("checked_plainly")

ARMS = ("chased", "fleeing")
KINDS = ("select", "safe", "filter", "clear")


def file_of(name, ending="npz"):
    return make_arms.FOLDER / f"{name}.{ending}"


@cache
def stored(name):
    with head_and_arrays(file_of(name)) as (head, arrays):
        return json.dumps(head), {one: arrays.array(one) for one in arrays.stated}


def parts_of(name):
    """The head of a table's file and its arrays, both to be changed."""
    head, arrays = stored(name)
    return json.loads(head), {one: array.copy() for one, array in arrays.items()}


def arm_of(head, arrays):
    return Arm(head, InMemory(arrays))


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_what_is_stored_is_what_is_made_today(name, tmp_path):
    table, words = make_arms.made(name)
    table.save(tmp_path / "made.npz")
    with head_and_arrays(tmp_path / "made.npz") as (head, arrays):
        made = {one: arrays.array(one) for one in arrays.stated}
    told, before = parts_of(name)
    assert all(told[one] == head[one] for one in ("digest", "recipe", "cells", "sensing", "sets", "formulas"))
    assert made.keys() == before.keys() and all(np.array_equal(made[one], before[one]) for one in made)
    assert words == file_of(name, "bin").read_bytes()


# ---- the twin

SAMPLES = 300
MUCH = 0.01  # of a cell


def path_of(disk, t):
    """Where a disk is at times (M,): two of (M,)."""
    path = disk["path"]
    if path["kind"] == "circle":
        angle = path["rate"] * t + path["phase"]
        return [at + path["radius"] * turn(angle) for at, turn in zip(path["centre"], (np.cos, np.sin), strict=True)]
    if path["kind"] == "line":
        return [at + v * t for at, v in zip(path["start"], path["velocity"], strict=True)]
    return [at + 0 * t for at in path["centre"]]


def to_links(elbow, tip, x, y):
    """The distance of places from the nearer link: (M,)."""
    each = []
    for (ax, ay), (bx, by) in ((0 * elbow, elbow), (elbow, tip)):
        share = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / ((bx - ax) ** 2 + (by - ay) ** 2)
        share = np.clip(share, 0, 1)
        each.append(np.hypot(x - ax - share * (bx - ax), y - ay - share * (by - ay)))
    return np.minimum(*each)


class Twin:
    """An arm's file by plain loops: its numbers, its sets as bool (entries, n1, n2, nx, ny), and its flags."""

    def __init__(self, head, arrays):
        given, cells = head["recipe"]["arguments"], head["cells"]
        self.given, self.shape, self.steps = given, tuple(cells["shape"]), given["steps"]
        self.agent = "pursuer" if "v_p_max" in given else "evader"
        self.axes = [
            [Fraction(low), Fraction(width), *map(Fraction, extent)]
            for low, width, extent in zip(cells["lowers"], cells["widths"], cells["extents"], strict=True)
        ]
        top, levels = Fraction(str(given["u_max"])), given["input_levels"]
        one = [-top + 2 * top * k / (levels - 1) for k in range(levels)]
        self.inputs = list(itertools.product(one, one))
        fastest = given["v_p_max" if self.agent == "pursuer" else "v_e_max"]
        l1, l2 = given["lengths"]
        turn = given["kinematics"] == "relative"
        self.world = SimpleNamespace(  # as `naive` reads it
            push=given["v_d_max"],
            agent=(fastest, given[f"{self.agent}_radius"] + given["half_width"]),
            inputs=np.array(self.inputs, dtype=float),
            arm=(l1, l2 if turn else l1 + l2, turn),
        )
        self.pushes = [Fraction(str(one)) for one in (given["v_d_max"], given["v_d_max"], fastest, fastest)]
        late = 2 * Fraction(str(head["sensing"].get("jitter", 0.0)))
        self.spans = [Fraction(str(given["delta"])) + way * late for way in (-1, 1)]
        self.pairs = [tuple(pair) for pair in naive.pairs(self.steps)]
        self.sets = naive.unpacked(arrays["pool"][arrays["index"]], self.shape[2:])
        self.sets = self.sets.reshape(len(self.pairs), *self.shape)
        flags = (self.steps, len(self.inputs), *self.shape[:2])
        bits = np.unpackbits(arrays["allowed"], count=math.prod(flags), bitorder="little")
        self.allowed = bits.astype(bool).reshape(flags)
        self.rng = np.random.default_rng(0)

    @cache  # noqa: B019  (there are a few twins)
    def fewest(self, start):
        """The fewest steps to go from each cell at a step: one more than are left where there are none."""
        own = [self.sets[naive.place_of(self.steps, start, n)] for n in range(self.steps - start + 1)]
        return len(own) - np.sum(own, axis=0)

    def into(self, arrays):
        """Its sets and flags as arrays of a file."""
        blocks = naive.packed(self.sets)
        pool, index = np.unique(blocks.reshape(-1, blocks.shape[-1]), axis=0, return_inverse=True)
        index = index.reshape(len(self.pairs), -1).astype(np.uint32)
        return arrays | {"pool": pool, "index": index, "allowed": np.packbits(self.allowed, bitorder="little")}

    def added(self):
        """The cells that each set adds to the one with a step less."""
        return [
            own & ~self.sets[at - 1] if n else own
            for at, (own, (_, n)) in enumerate(zip(self.sets, self.pairs, strict=True))
        ]

    @cache  # noqa: B019  (there are a few twins)
    def image(self, axis, j, cell):
        """The cells that an interval may lead to from one, along an axis: those that overlap where it can end."""
        n, (_, width, *lengths), push = self.shape[axis], self.axes[axis], self.pushes[axis]
        drift = self.inputs[j][axis] if axis < 2 else 0
        ends = [(drift + way * push) * span for way in (-1, 1) for span in self.spans]
        # whole numbers, which are as exact as the fractions
        over = math.lcm(*(one.denominator for one in (width, *lengths, *ends)))
        width, *lengths, back, ahead = (int(one * over) for one in (width, *lengths, min(ends), max(ends)))
        found = set()
        for length, lap in itertools.product(lengths, range(-3, 4) if axis < 2 else [0]):
            low, high = cell * width + back + lap * length, min((cell + 1) * width, length) + ahead + lap * length
            found |= {k for k in range(n) if low < min((k + 1) * width, length) and high > k * width}
        return sorted(found)

    def reaches(self, cell, j, start, within):
        """Whether all that an interval may lead to from a cell is in the set of the next step, with a step less."""
        after = self.sets[naive.place_of(self.steps, start + 1, within - 1)]
        return bool(after[np.ix_(*(self.image(axis, j, one) for axis, one in enumerate(cell)))].all())

    def bounds(self, cell):
        """The lower and the upper end of a cell along each axis."""
        ends = ((low + k * width, low + (k + 1) * width) for (low, width, *_), k in zip(self.axes, cell, strict=True))
        return np.array([float(one) for pair in ends for one in pair])

    def touches(self, cell, j, start, duration, disks, agent):
        """The share of samples of a cell that touch a disk, or the pursuer."""
        agent = agent and self.agent == "pursuer"
        if not disks and not agent:
            return 0.0
        states, taus = naive.states_during(self.world, self.bounds(cell), j, duration, self.rng, SAMPLES)
        bodies = [(path_of(disk, start + taus), disk["radius"] + self.given["half_width"]) for disk in disks]
        bodies += [(states[:, 2:].T, self.world.agent[1])] * agent
        arm = self.joints(states)
        return max((to_links(*arm, *place) <= contact).mean() for place, contact in bodies)

    def misses(self, cell, t):
        """The share of samples of a cell that have the tip outside the target."""
        states, taus = naive.states_during(self.world, self.bounds(cell), 0, 0.0, self.rng, SAMPLES)
        (x, y), goal = self.joints(states)[1], self.given.get("target")
        place, radius = (
            (path_of(goal, t + taus), goal["radius"]) if goal else (states.T[2:], self.given["evader_radius"])
        )
        return (np.hypot(x - place[0], y - place[1]) > radius).mean()

    def joints(self, states):
        """The elbow and the tip at states (M, 4): (2, M) each."""
        (q1, q2), (l1, l2, turn) = states.T[:2], self.world.arm
        elbow = l1 * np.stack([np.cos(q1), np.sin(q1)])
        return elbow, elbow + l2 * np.stack([np.cos(turn * q1 + q2), np.sin(turn * q1 + q2)])

    def flag_is_false(self, start, j, i1, i2):
        """Whether the arm meets an obstacle from much of a cell of the joints under an input."""
        t, known = start * self.given["delta"], self.given["obstacles"]
        return self.touches((i1, i2, 0, 0), j, t, float(self.spans[1]), known, False) > MUCH

    def cell_is_false(self, start, within, cell):
        """Whether much of a cell is no goal, or no input leads on from all of it."""
        if within == 0:
            t = start * self.given["delta"]
            return self.misses(cell, t) > MUCH or self.touches(cell, 0, t, 0.0, self.given["obstacles"], True) > MUCH
        return all(
            not self.allowed[start, j, cell[0], cell[1]]
            or not self.reaches(cell, j, start, within)
            or self.touches(cell, j, 0.0, float(self.spans[1]), [], True) > MUCH
            for j in range(len(self.inputs))
        )


@cache
def twin_of(name):
    return Twin(*parts_of(name))


# ---- all claims of a file


@cache
def proved(name):
    """The claims of a file and of its export: how many are made, by name; all are proved."""
    verdict = verify(file_of(name), exported=file_of(name, "bin"), progress=False)
    assert verdict.ok and all(one.checked == one.made for one in verdict.claims), str(verdict)
    return {one.name: one.made for one in verdict.claims}


@pytest.mark.parametrize("name", ARMS)
def test_every_claim_of_a_file_is_proved_and_counted(name):
    twin = twin_of(name)
    made = {"cells cover the axes": 4, "sets grow with the steps to go": sum(n > 0 for _, n in twin.pairs)}
    made |= {"clear of the obstacles": twin.allowed.sum(), "in the target, and safe": new_within(twin, 0)}
    made |= {f"one step nearer, within {n}": new_within(twin, n) for n in range(1, twin.steps + 1)}
    assert {one: many for one, many in proved(name).items() if "exported" not in one} == made
    assert min(made.values()) > 0
    few = [verify(file_of(name), samples=8, seed=seed, progress=False) for seed in (0, 1)]
    assert all(one.ok for one in few) and few[0] != few[1]
    assert all(0 < sum(one.checked for one in each.claims) < sum(made.values()) for each in few)


def new_within(twin, n, rows=...):
    """How many cells sets add that have n steps to go, in some rows."""
    each = [own for own, pair in zip(twin.added(), twin.pairs, strict=True) if pair[1] == n]
    return int(sum(own.reshape(-1, *twin.shape[2:])[rows].sum() for own in each))


@pytest.mark.parametrize("name", ARMS)
def test_some_rows_are_checked_by_what_they_lead_to_alone(name, monkeypatch, rng):
    """Others are eroded for nobody; each of several threads has rows of its own."""
    monkeypatch.setattr(arm_claims, "ROWS_AT_ONCE", 3)
    twin, arm = twin_of(name), arm_of(*parts_of(name))
    rows = rng.permutation(arm.index.shape[1])[:10]
    found = [*arm.claims(rows, True)]
    assert not any(one.failed for one in found)
    flags = twin.allowed.reshape(-1, arm.index.shape[1])[:, rows].sum()
    sizes = [flags, *(new_within(twin, n, rows) for n in range(twin.steps + 1))]
    assert [one.checked for one in found[2:]] == sizes and sum(sizes) > 50
    assert all(one.checked < one.made for one in found[2:])


def test_an_arm_stands_still_where_neither_its_target_nor_an_obstacle_moves(monkeypatch):
    monkeypatch.setattr(arm_claims, "expect_recipe", lambda *_: None)
    for moving in ({"target", "unsafe 0"}, {"target"}, {"unsafe 0"}, set()):
        head, arrays = parts_of("chased")
        for name in {"target", "unsafe 0"} - moving:
            head["formulas"]["functions"][name]["lines"] = ["const 0x1.0p+0", "return 0"]
        assert arm_of(head, arrays).still == (not moving)


@pytest.mark.parametrize("name", ARMS)
def test_memory_for_three_copies_and_all_flags_is_asked_for(name):
    with head_and_arrays(file_of(name)) as (_, arrays):
        needed, made = Arm.bytes_needed(arrays), [arrays.array(one) for one in ("allowed", "index", "pool")]
    least = 3 * sum(one.nbytes for one in made) + twin_of(name).allowed.size
    assert least <= needed < least + 5000  # what stands before the numbers of an array


# ---- lies in a file: cells and flags more


@cache
def lies_of(name):
    """A twin with some flags and cells more that are surely false; and these, by place."""
    twin, rng = Twin(*parts_of(name)), np.random.default_rng(1)
    true, flags = twin.sets.copy(), set()
    for at in rng.permutation(np.argwhere(~twin.allowed))[:30].tolist():
        flags |= {tuple(at)} if twin.flag_is_false(*at) else set()
    for at in flags:  # they are believed of cells
        twin.allowed[at] = True
    for at, (start, within) in enumerate(twin.pairs):
        # nothing moves around who flees, so that sets of later steps are inside those of step 0
        starts = {start, 0} if name == "fleeing" else {start}
        for cell in rng.permutation(np.argwhere(~true[at]))[:12].tolist():
            places = [(k, n) for k in starts for n in range(within, twin.steps - k + 1)]
            if all(twin.cell_is_false(k, within, cell) for k, _ in places):
                for k, n in places:
                    twin.sets[naive.place_of(twin.steps, k, n), *cell] = True
    cells = set()
    for own, before, (start, within) in zip(twin.added(), true, twin.pairs, strict=True):
        cells |= {(start, within, tuple(cell)) for cell in np.argwhere(own & ~before).tolist()}
    assert all(twin.cell_is_false(*one) for one in cells)
    return twin, flags, cells


@pytest.mark.parametrize("name", ARMS)
def test_flags_and_cells_too_many_are_counted_and_named(name, monkeypatch, rng):
    monkeypatch.setattr(arm_claims, "ROWS_AT_ONCE", 9)
    monkeypatch.setattr(separation, "GRANTED", 20)  # what is true needs fewer, and no number proves what is false
    (twin, flags, cells), (head, arrays), kept = lies_of(name), parts_of(name), []
    arm = arm_of(head, twin.into(arrays))
    arm.checked = lambda *given: kept.append(Arm.checked(arm, *given)) or kept[0]
    rows = rng.permutation(arm.index.shape[1])
    claims, ((failed, example),) = [*arm.claims(rows, True)][2:], kept
    _, n2, nx, ny = twin.shape
    places = [{} for _ in range(twin.steps + 2)]  # by kinds: of each row the places of lies
    for start, j, i1, i2 in flags:
        places[0].setdefault(i1 * n2 + i2, set()).add(start * len(twin.inputs) + j)
    for start, within, (i1, i2, x, y) in cells:
        places[1 + within].setdefault(i1 * n2 + i2, set()).add(start * nx * ny + x * ny + y)
    for kind, (claim, own) in enumerate(zip(claims, places, strict=True)):
        lies = [own.get(row, set()) for row in rows.tolist()]
        assert failed[:, kind].tolist() == [*map(len, lies)] and sum(map(len, lies)) > 9
        assert all(example[number, kind] in each for number, each in enumerate(lies) if each)
        assert claim.failed == failed[:, kind].sum() and claim.checked == claim.made
        at = [[int(digits) for digits in re.findall(r"\d+", text)] for text in claim.failures]
        if kind:
            assert all((start, within, tuple(cell)) in cells for start, within, *cell in at)
            assert {within for _, within, *_ in at} == {kind - 1}
        else:
            assert all(tuple(one) in flags for one in at)
        named = [i1 * n2 + i2 for *_, i1, i2 in (one[2:4] if kind else one[2:] for one in at)]
        assert named == rows[np.flatnonzero(failed[:, kind])[:5]].tolist()


def test_nothing_is_proved_of_inputs_that_are_held_for_long(monkeypatch, rng):
    """In five seconds the arm and the pursuer may be anywhere."""
    monkeypatch.setattr(separation, "GRANTED", 5)
    made, twin = arm("chased"), twin_of("chased")
    long = made.scene.world(made.edges)._replace(held=5.0)
    rows = rng.permutation(np.flatnonzero(np.any(twin.added(), axis=(0, 3, 4)).ravel()))[:8]
    failed, _ = made.checked(rows, long, True)
    flags = twin.allowed.reshape(-1, made.index.shape[1])[:, rows].sum()
    assert failed[:, 2:].sum(axis=0).tolist() == [new_within(twin, n, rows) for n in (1, 2, 3)]
    assert failed[:, 0].sum() == flags > 0
    monkeypatch.setattr(made.scene, "world", lambda edges: long)
    words = words_of("chased", "clear")
    few = rng.permutation(np.argwhere(words.fields["clear"]))[:20]
    words.fields["clear"][...] = False
    words.fields["clear"][tuple(few.T)] = True
    found = {one.name: one for one in claims_of_export(words, made, True)}["exported: clear"]
    assert sum(int(text.split()[0]) for text in found.failures) == found.made == 20


# ---- words of an export


@cache
def exported(name):
    return Words(file_of(name, "bin"))


def words_of(name, *fields):
    """The words of a table's export, one of its own for each cell of each step, of some fields, to be changed."""
    words = copy(exported(name))
    each = [np.concatenate([own for _, own in words.ids(start)]) for start in range(words.starts)]
    words.fields = {one: exported(name).fields[one][np.concatenate(each)] for one in fields or FIELDS}
    words.images = [own.copy() for own in words.images]
    cells = len(each[0])
    words.ids = lambda start: [(slice(0, cells), np.arange(start * cells, (start + 1) * cells))]
    return words


def marked(words, kind, shape):
    """The inputs that words of single cells claim in a kind: (starts, *cells, L) bool."""
    own = words.fields[kind]
    own = own[:, None] == np.arange(len(words.inputs)) if kind == "select" else own
    return own.reshape(words.starts, *shape, len(words.inputs))


def refused(name, words):
    """The claims of an export, by name, without those of which nothing is wrong."""
    return {
        one.name.removeprefix("exported: "): one.failures
        for one in claims_of_export(words, arm(name), True)
        if one.failed
    }


@cache
def arm(name):
    return arm_of(*parts_of(name))


@pytest.mark.parametrize("name", ARMS)
def test_every_word_of_an_export_is_proved_and_counted(name):
    twin, words = twin_of(name), words_of(name)
    made = {"the cells and inputs are the table's": 1, "steps": (words.fields["steps"] != UNPROVED).sum()}
    made |= {kind: marked(words, kind, twin.shape).sum() for kind in KINDS}
    made["select"] += (words.fields["select"] == ARRIVED).sum()
    assert min(made.values()) > 0
    made |= {"images": len(twin.inputs) * sum(twin.shape)} if name == "fleeing" else {}
    found = proved(name).items()
    assert {one.removeprefix("exported: "): many for one, many in found if "exported" in one} == made
    steps = words.fields["steps"].reshape(words.starts, *twin.shape)
    for start, own in enumerate(steps):
        assert np.array_equal(np.minimum(own, twin.steps - start + 1), twin.fewest(start))


def test_an_input_is_proved_in_whatever_field_it_is():
    """Each input of each cell stands in one of the fields alone."""
    twin, words = twin_of("fleeing"), words_of("fleeing")
    for number, kind in enumerate(KINDS[1:]):
        own = words.fields[kind]
        own &= np.add.outer(np.arange(len(own)), np.arange(own.shape[1])) % 3 == number
    assert all(marked(words, kind, twin.shape).sum() > 99 for kind in KINDS[1:])
    words.fields["select"] = np.full_like(words.fields["select"], NO_INPUT)
    assert refused("fleeing", words) == {}


def false_inputs(twin, words, kind, rng):
    """Inputs (start, *cell, j) that words of a kind do not claim and that are surely false, some for each reason."""
    steps, claimed = words.fields["steps"].reshape(words.starts, *twin.shape), marked(words, kind, twin.shape)
    found = {
        "last step": [],
        "no set": [],
        "obstacle": [],
        "later obstacle": [],
        "next set": [],
        "fewer steps": [],
        "agent": [],
    }
    for start, *cell, j in rng.permutation(np.argwhere(~claimed))[:1200].tolist():
        left, go = twin.steps - start, steps[start, *cell]
        if left == 0:
            why = "last step"
        elif kind in ("select", "safe") and go == UNPROVED:
            why = "no set"
        elif not twin.allowed[start, j, *cell[:2]]:
            why = "later obstacle" if twin.allowed[0, j, *cell[:2]] else "obstacle"
        elif kind != "clear" and not twin.reaches(cell, j, start, left):
            why = "next set"
        elif kind in ("select", "safe") and not twin.reaches(cell, j, start, max(go, 1)):
            why = "fewer steps"
        else:
            why = "agent"
        if len(found[why]) < 4 and (
            why != "agent" or twin.touches(cell, j, 0.0, float(twin.spans[1]), [], True) > MUCH
        ):
            found[why].append((start, *cell, j))
    return found


@pytest.mark.parametrize("name", ARMS)
def test_every_input_too_many_of_an_export_is_counted(name, monkeypatch, rng):
    """Many lead into sets that are larger than they may be, which are believed here: but from there the arm touches."""
    monkeypatch.setattr(arm_claims, "ROWS_AT_ONCE", 9)
    monkeypatch.setattr(separation, "GRANTED", 20)
    (head, arrays), words, lies = parts_of(name), words_of(name), {}
    twin = Twin(head, arrays)
    much = 3 * twin.shape[2] // 4
    for own, (_, within) in zip(twin.sets, twin.pairs, strict=True):
        own[..., :much, :] |= within > 0
    steps = words.fields["steps"].reshape(words.starts, *twin.shape)[: twin.steps, ..., :much, :]  # a view
    for start, own in enumerate(steps):
        own[...] = np.where(own < UNPROVED, own, rng.choice([1, twin.steps - start], own.shape))
    before = {kind: marked(words, kind, twin.shape).sum(axis=(0, 3, 4, 5)).ravel() for kind in KINDS}
    for kind in KINDS:
        found = false_inputs(twin, words, kind, rng)
        never = {"last step", "later obstacle", "agent"} if name == "fleeing" else set()
        never |= {"filter": {"no set", "fewer steps"}, "clear": {"no set", "next set", "fewer steps"}}.get(kind, set())
        assert {why for why, own in found.items() if len(own) < 4} == never, kind
        lies[kind] = [*itertools.chain(*found.values())]
        for start, *cell, j in lies[kind]:
            at = np.ravel_multi_index((start, *cell), (words.starts, *twin.shape))
            words.fields[kind][at if kind == "select" else (at, j)] = j if kind == "select" else True
    claims = {one.name: one for one in claims_of_export(words, arm_of(head, twin.into(arrays)), True)}
    for kind in KINDS:
        own, n2 = claims[f"exported: {kind}"], twin.shape[1]
        rows = Counter(i1 * n2 + i2 for _, i1, i2, *_ in lies[kind])
        told = dict(map(int, re.findall(r"\d+", text)[::-1]) for text in own.failures)
        assert told == rows, kind
        if kind != "select":
            assert own.made == before[kind].sum() + len(lies[kind])


@pytest.mark.parametrize("name", ARMS)
def test_steps_to_go_that_are_not_proved_are_named(name, rng):
    """As many as are proved or more are a smaller claim, up to those that are left."""
    twin, words = twin_of(name), words_of(name, "steps", "select")
    wrong = {"steps": [], "select": []}
    shape = words.starts, math.prod(twin.shape)
    steps = words.fields["steps"] = rng.integers(0, twin.steps + 3, shape)
    steps[steps == twin.steps + 2] = UNPROVED
    select = words.fields["select"] = rng.choice([ARRIVED, NO_INPUT], shape)
    made = {"steps": (steps != UNPROVED).sum(), "select": (select == ARRIVED).sum()}
    for start, cell in np.ndindex(shape):
        fewest, left = twin.fewest(start).flat[cell], twin.steps - start
        said = steps[start, cell]
        if said != UNPROVED and (said < fewest or said > left):
            wrong["steps"].append(f"start {start}, cell {cell}")
        if select[start, cell] == ARRIVED and fewest > 0:
            wrong["select"].append(f"start {start}, cell {cell}")
    words.fields = {one: own.ravel() for one, own in words.fields.items()}
    found = {one.name.removeprefix("exported: "): one for one in claims_of_export(words, arm(name), True)}
    assert {one: found[one].failures for one in wrong} == wrong
    assert {one: found[one].made for one in made} == made


def test_images_are_neither_wider_nor_narrower():
    """Each end of an image in the middle of each axis is a cell off, to either side, each under an input of its own."""
    words = words_of("fleeing", "steps")
    lies = [*itertools.product(range(4), (0, 1), (-1, 1))]
    for number, (axis, side, by) in enumerate(lies):
        words.images[axis][0, number % 4 * 2, words.counts[axis] // 2, side] += by
    wrong = sorted({(number % 4 * 2, axis) for number, (axis, *_) in enumerate(lies)}, key=lambda one: one[::-1])
    for axis in (2, 3):  # past a wall is nothing
        words.images[axis][0, 1, 0, 0] -= 1
        words.images[axis][0, 1, -1, 1] += 1
    assert refused("fleeing", words) == {"images": [f"start 0, input {j}, axis {axis}" for j, axis in wrong]}
    assert len(wrong) == len(lies)


def test_images_of_all_cells_or_of_other_axes_are_refused():
    words = words_of("fleeing", "steps")
    words.images[0][0, 3, :, 1] = 100
    words.images[1] = np.repeat(words.images[1][:, :, None], words.counts[0], axis=2)
    words.reads = words.reads.copy()
    words.reads[1, 0] = True
    expected = ["start 0, input 3, axis 0", *(f"start 0, input {j}, axis 1" for j in range(9))]
    assert refused("fleeing", words) == {"images": expected}


HEADS = {  # which number of an export is another, of those that an arm has of its own, and which claim names it
    "starts": ("starts", lambda own: own + 1),
    "slack": ("slack", lambda own: own * (1 - 1e-6)),
    "error": ("error", lambda own: own - [1e-9, 0, 0, 0]),
    "leads": ("steps with images of their own", lambda own: 1 - own),
}


@pytest.mark.parametrize("name", ARMS)
def test_numbers_of_another_table_end_the_check_of_an_export(name):
    for attribute, (said, forge) in HEADS.items():
        words = copy(exported(name))
        setattr(words, attribute, forge(getattr(words, attribute)))
        told = refused(name, words)
        assert told.pop("the cells and inputs are the table's")[0].startswith(f"{said}: "), attribute
        assert not told


# ---- what is no table of an arm


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("half_width", True),
        ("pursuer_radius", -1.0),
        ("v_d_max", -0.1),
        ("delta", math.inf),
        ("steps", 0),
        ("input_levels", 1),
        ("input_levels", 10**30),
        ("lengths", [0.15]),
        ("lengths", None),
        ("kinematics", "foo"),
        ("obstacles", {}),
        ("obstacles", [3]),
        ("obstacles", [STILL | {"radius": -1.0}]),
        ("obstacles", [STILL | {"path": STILL["path"] | {"kind": "spiral"}}]),
        ("obstacles", [STILL | {"path": STILL["path"] | {"centre": [0.0]}}]),
        ("obstacles", [CIRCLE | {"path": CIRCLE["path"] | {"rate": None}}]),
        ("target", None),
        ("target", {}),
    ],
)
def test_numbers_that_make_no_sense_are_refused(name, value, monkeypatch):
    monkeypatch.setattr(arm_claims, "expect_recipe", lambda *_: None)  # to which any other number is wrong
    head, arrays = parts_of("chased")
    head["recipe"]["arguments"][name] = value
    with pytest.raises((ValueError, LookupError, TypeError)):
        arm_of(head, arrays)


def past_the_last(pool):
    """The last block has a cell more than there are."""
    pool[-1, -1] |= np.uint64(2)
    return pool


SENSELESS = {  # what is read after the recipe, and what is said of it
    "three numbers of cells": (lambda told, arrays: told["cells"]["shape"].pop(), "numbers of cells"),
    "no number of cells": (lambda told, arrays: told["cells"].update(shape=32), "numbers of cells"),
    "one cell": (lambda told, arrays: told["cells"].update(shape=[7, 5, 13, 1]), "numbers of cells"),
    "many cells": (lambda told, arrays: told["cells"].update(shape=[7, 5, 10**7, 13]), "numbers of cells"),
    "layers": (lambda told, arrays: told["cells"].update(layers=[[0, 0]] * 3 + [[1, 0]]), "have their width"),
    "three widths": (lambda told, arrays: told["cells"]["widths"].pop(), "shorter"),
    "three axes": (lambda told, arrays: [told["cells"][one].pop() for one in ENDS], "4 axes"),
    "five axes": (lambda told, arrays: [told["cells"][one].append(told["cells"][one][0]) for one in ENDS], "4 axes"),
    "other numbers": (replaced("index", lambda old: old.astype(np.int64)), "index must be an array"),
    "a set too few": (replaced("index", lambda old: old[1:]), "index must be kept"),
    "a row too few": (replaced("index", lambda old: old[:, 1:]), "index must be kept"),
    "a block beyond the pool": (replaced("pool", lambda old: old[:-1]), "pool must be kept"),
    "a block of nobody": (replaced("pool", lambda old: np.append(old, old[:1], axis=0)), "pool must be kept"),
    "wider blocks": (replaced("pool", lambda old: np.append(old, old, axis=1)), "pool must be kept"),
    "a cell past the last one": (replaced("pool", past_the_last), "no cells that there are not"),
    "flags too few": (replaced("allowed", lambda old: old[:-1]), "allowed must be kept"),
    "flags too many": (replaced("allowed", lambda old: np.append(old, old[:1])), "allowed must be kept"),
    "jitter at a target that moves": (lambda told, arrays: told["sensing"].update(jitter=0.01), "at rest"),
}
ENDS = ("lowers", "widths", "extents")


@pytest.mark.parametrize("lie", SENSELESS)
def test_cells_that_make_no_sense_are_refused(lie, monkeypatch):
    monkeypatch.setattr(arm_claims, "expect_recipe", lambda *_: None)  # which other tests ask
    (head, arrays), (forge, said) = parts_of("chased"), SENSELESS[lie]
    forge(head, arrays)
    with pytest.raises(ValueError, match=said):
        arm_of(head, arrays)


# ---- cells that cover, sets that grow


def test_cells_that_do_not_cover_are_found():
    """Then nothing else is asked."""
    whole = copy(arm("chased"))
    whole.counts, box = np.array([32, 32, 8, 8]), whole.scene.box
    fine = [(Fraction(0), PI[1] / 16, 2 * PI[0], 2 * PI[1])] * 2 + [(-box, box / 4, 2 * box, 2 * box)] * 2
    whole.axes = fine
    assert not whole.uncovered()
    for axis, changes in (
        (0, {2: Fraction(22, 7) * 2, 3: Fraction(22, 7) * 2}),
        (1, {2: 2 * PI[1]}),
        (1, {2: 2 * PI[0] - Fraction(2, 10**13)}),
        (1, {3: 2 * PI[0]}),
        (0, {1: PI[0] / 16}),
        (1, {1: 2 * PI[1] / 31}),
        (3, {1: box / 4 * Fraction(99, 100)}),
        (3, {1: box / 4 * Fraction(8, 7)}),
        (2, {0: -box + 1}),
        (2, {2: 2 * box - box / 8, 3: 2 * box - box / 8}),
        (2, {3: 2 * box + Fraction(1, 10**20)}),
    ):
        axes = [list(one) for one in fine]
        for place, value in changes.items():
            axes[axis][place] = value
        whole.axes = [tuple(one) for one in axes]
        (claim,) = whole.claims(np.arange(1), True)
        assert (claim.made, claim.checked) == (4, 4)
        assert [wrong.startswith(f"axis {axis}: ") for wrong in claim.failures] == [True], (axis, changes)


def test_survey_agrees_with_the_twin(rng):
    steps, shape = 2, (4, 3, 5, 6)
    cells, index, pool = naive.sets_of(steps, shape, rng, [0.97] * 3)
    file = SimpleNamespace(
        steps=steps, pairs=naive.pairs(steps), counts=np.array(shape), index=index, pool=pool, still=False
    )
    counts, grow = cells_added(file)
    assert grow.failed == 0
    expected, at = np.zeros_like(counts), 0
    for k in range(steps + 1):
        for n in range(steps - k + 1):
            new = cells[at] & ~cells[at - 1] if n else cells[at]
            for cell in np.argwhere(new):
                expected[cell[0] * shape[1] + cell[1], n] += 1
            at += 1
    np.testing.assert_array_equal(counts, expected)
    file.index = index.copy()
    file.index[1, 7] = np.flatnonzero((pool & pool[index[0, 7]] != pool[index[0, 7]]).any(axis=1))[0]
    assert "0: the set within" in cells_added(file)[1].failures[0]

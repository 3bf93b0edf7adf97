"""The claims of a file: it proves what holds, and finds what was planted."""

import shutil

import naive_certified as naive
import numpy as np
import pytest
from forging import describe, forged
from naive_certified import CIRCLE, LINE, SMALL, STILL

import sdhj
from sdhj.arm.case_studies import rebuild
from sdhj.certified.check import sampled, verify
from sdhj.certified.check.reading import head_and_arrays

pytestmark = pytest.mark.slow  # to compile the checker takes half a minute


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """The certified table of a small problem in a file, and the table."""
    problem = sdhj.arm_case_study(**(SMALL | {"v_p_max": 0.9}))
    table = sdhj.solve(problem, sdhj.Certified(cells=(32, 32, 8, 8), parts=4), progress=False)
    return write(table, tmp_path_factory.mktemp("verify") / "small.npz"), table


def write(table, path):
    table.save(path)
    return path


def claims_of(report):
    return {claim.name: claim for claim in report.claims}


def test_every_claim_of_a_small_file_is_proved(saved):
    path, table = saved
    report = verify(path)
    assert report.ok, str(report)
    claims = claims_of(report)
    added = table.bits(start=0, within=2) & ~table.bits(start=0, within=1)
    assert claims["one step nearer, within 2"].checked == claims["one step nearer, within 2"].made == added.sum() > 0
    assert claims["clear of the obstacles"].checked == table.proof.motion.allowed.sum()
    assert "proved" in str(report) and "NOT" not in str(report)


def test_rows_are_drawn_and_counted(saved):
    report = verify(saved[0], samples=300, seed=1)
    assert report.ok
    claims = claims_of(report)
    nearer = claims["one step nearer, within 1"]
    assert 0 < nearer.checked < nearer.made
    assert str(verify(saved[0], samples=np.int64(300), seed=np.uint8(1))) == str(report)
    assert str(verify(saved[0], samples=300, seed=2)) != str(report)


def test_a_solve_looks_at_the_rows_drawn_and_counts_their_claims(saved, monkeypatch):
    monkeypatch.setattr(sampled, "MOST_WHOLE", 0)
    monkeypatch.setattr(sampled, "SAMPLED", 3000)
    with head_and_arrays(saved[0]) as (told, file):
        arrays = {name: file.array(name).copy() for name in file.stated}
    looked, made, wrong = sampled.looked_over(told, arrays, None)
    assert not wrong and made == sum(claim.made for claim in verify(saved[0]).claims) and 3000 <= looked < made / 2
    arrays["allowed"].fill(255)
    assert "clear of the obstacles: start" in sampled.looked_over(told, arrays, None)[2][0]


@pytest.mark.parametrize("name", ["printed", "evader"])
def test_every_claim_of_other_arms_is_proved(name, tmp_path):
    obstacles = [STILL, LINE, CIRCLE]
    if name == "evader":
        numbers = {"v_e_max": 0.3, "evader_radius": 0.14, "u_max": 4.0, "v_d_max": 1.0}
        problem = sdhj.evader_case_study(nodes=9, steps=2, input_levels=3, obstacles=obstacles, **numbers)
    else:
        problem = sdhj.arm_case_study(**(SMALL | {"kinematics": "printed", "obstacles": obstacles}))
    table = sdhj.solve(problem, sdhj.Certified(cells=(63, 63, 24, 24), parts=4), progress=False)
    report = verify(write(table, tmp_path / "other.npz"))
    assert report.ok, str(report)
    assert claims_of(report)["one step nearer, within 1"].checked > 100


# ---- planted faults


@pytest.fixture(scope="module")
def still():
    """A small table of an arm in a scene of which nothing moves."""
    target = {"radius": 0.09, "path": {"kind": "still", "centre": [0.05, 0.2]}}
    problem = sdhj.arm_case_study(
        **(SMALL | {"target": target, "obstacles": [STILL | {"radius": 0.03}], "v_d_max": 0.02, "v_p_max": 0.02})
    )
    assert problem.time_invariant
    return sdhj.solve(problem, sdhj.Certified(cells=(40, 40, 16, 16)), progress=False, play=False)


def test_where_nothing_moves_sets_of_step_0_hold_those_of_later_steps(still, tmp_path):
    """It is asked alone: else what leads into a set of step 1 finds no answer there."""
    path = write(still, tmp_path / "still.npz")
    assert verify(path).ok
    with forged(path) as (_, arrays):
        none, one, two, *later = arrays["index"]
        pool = np.concatenate([arrays["pool"], arrays["pool"][two] & ~arrays["pool"][none]])
        assert pool[-len(two) :].any()
        rest = np.arange(len(pool) - len(two), len(pool), dtype=np.uint32)
        arrays |= {"pool": pool, "index": np.stack([0 * none, 0 * one, rest, *later])}
    failed = {name: claim.failed for name, claim in claims_of(verify(path)).items() if claim.failed}
    assert failed == {"sets grow with the steps to go": 3}


def test_what_is_exported_where_nothing_moves_is_proved(still, tmp_path):
    """Its words are those of all steps."""
    path = write(still, tmp_path / "still.npz")
    sdhj.export_c(still, tmp_path / "c", progress=False)
    assert verify(path, exported=tmp_path / "c").ok


def planted(saved, tmp_path, change):
    """Report on a copy of the file that `change` was let loose on: what it tells, and its arrays."""
    path = tmp_path / "planted.npz"
    shutil.copy(saved[0], path)
    with forged(path) as (told, arrays):
        change(told, arrays)
    return verify(path)


def rewrite(group, name, data):
    del group[name]
    group[name] = data


def flip(group, table, start, within, cell):
    """Flip one cell of one set, in a block of its own."""
    index, pool = group["index"][()], group["pool"][()]
    _, n2, _, ny = table.shape
    place, row, bit = naive.place_of(table.steps, start, within), cell[0] * n2 + cell[1], cell[2] * ny + cell[3]
    block = pool[index[place, row]].copy()
    block[bit // 64] ^= np.uint64(1) << np.uint64(bit % 64)
    index[place, row] = len(pool)
    rewrite(group, "index", index)
    rewrite(group, "pool", np.concatenate([pool, block[None]]))


def test_a_cell_too_many_is_found(saved, tmp_path, rng):
    """A cell beside a set is added to it. (One that the solver left out needlessly may be proved, not more.)"""
    _, table = saved
    found = 0
    for start, within in ((0, 2), (1, 1), (1, 0)):
        inside = table.bits(start=start, within=within)
        outside = np.argwhere(~inside & np.roll(inside, 1, axis=0))
        cell = rng.permutation(outside)[0]
        report = planted(saved, tmp_path, lambda told, group, c=cell, k=start, n=within: flip(group, table, k, n, c))
        found += not report.ok
        named = [failure for claim in report.claims for failure in claim.failures]
        assert report.ok or f"start {start}, within {within}, cell {tuple(cell.tolist())}" in named
    assert found >= 2


def test_a_cell_too_few_is_found_where_others_rest_on_it(saved, tmp_path, rng):
    """A cell in the middle of S_1^1 is taken away: cells of S_0^2 lose what they end in, S_1^0 is inside no more."""
    _, table = saved
    inside = table.bits(start=1, within=1)
    deep = inside & np.roll(inside, 1, axis=0) & np.roll(inside, -1, axis=0) & np.roll(inside, 1, axis=1)
    cell = rng.permutation(np.argwhere(deep & table.bits(start=1, within=0)))[0]
    report = planted(saved, tmp_path, lambda told, group: flip(group, table, 1, 1, cell))
    assert not report.ok
    assert any("not inside" in failure for claim in report.claims for failure in claim.failures)


def test_an_input_bit_too_many_is_found(saved, tmp_path, rng):
    _, table = saved
    allowed = table.proof.motion.allowed
    sure = allowed.copy()  # blocked beside blocked: not only by a hair
    for axis in (2, 3):
        for side in (-1, 1):
            sure |= np.roll(allowed, side, axis=axis)
    for place in rng.permutation(np.argwhere(~sure))[:2]:
        changed = allowed.copy()
        changed[tuple(place)] = True
        bits = np.packbits(changed, bitorder="little")
        report = planted(saved, tmp_path, lambda told, group, b=bits: rewrite(group, "allowed", b))
        wrong = claims_of(report)["clear of the obstacles"]
        assert wrong.failed == 1
        assert wrong.failures == ["start {}, input {}, joints {}, {}".format(*place.tolist())]


def test_wrong_cells_end_the_check(saved, tmp_path):
    def wider(told, arrays):
        told["cells"]["widths"][0] = "19/100"

    report = planted(saved, tmp_path, wider)
    assert [claim.failed for claim in report.claims] == [1]


def test_a_stronger_adversary_is_not_proved(saved, tmp_path):
    """The sets of one problem under the numbers of harder ones."""
    problem = saved[1].problem
    for name, old, new in (("v_d_max", 2.0, 2.1), ("v_p_max", 0.9, 1.0)):
        assert problem.recipe["arguments"][name] == old
        harder = rebuild({**problem.recipe, "arguments": {**problem.recipe["arguments"], name: new}})
        path = shutil.copy(saved[0], tmp_path / "harder.npz")
        describe(path, harder)
        with forged(path, named=True) as (told, _):
            told["recipe"] = harder.recipe
        report = verify(path)
        assert not report.ok and "NOT proved" in str(report)


def test_files_that_cannot_be_checked_are_refused(saved, tmp_path):
    np.savez(tmp_path / "empty.npz", index=np.zeros(3))
    with pytest.raises(ValueError, match="no certified sets"):
        verify(tmp_path / "empty.npz")
    with pytest.raises(ValueError, match="no certified sets; make"):
        planted(saved, tmp_path, lambda told, arrays: told.__delitem__("cells"))
    with pytest.raises(ValueError, match="make no sense"):
        planted(saved, tmp_path, lambda told, arrays: told["cells"].update(kind="enclosed"))

    def beyond_the_pool(told, group):
        rewrite(group, "index", group["index"][()] + np.uint32(len(group["pool"])))

    with pytest.raises(ValueError, match="damaged"):
        planted(saved, tmp_path, beyond_the_pool)


def test_samples_and_seed_that_make_no_sense_are_refused(saved):
    for options in ({"samples": 0}, {"samples": -1}, {"samples": True}, {"seed": -1}, {"seed": 0.5}):
        with pytest.raises(ValueError, match="must be a"):
            verify(saved[0], **options)

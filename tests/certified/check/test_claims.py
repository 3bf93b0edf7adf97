"""Tables of arms solved, saved, exported and verified by the checker as users run it: compiled, which takes a while."""

import numpy as np
import pytest
from forging import forged
from naive_certified import CIRCLE, LINE, SMALL, STILL

import sdhj
from sdhj.certified.check import verify

pytestmark = pytest.mark.slow

AMONG = {"obstacles": [STILL, LINE, CIRCLE]}
FLEES = AMONG | {"v_e_max": 0.3, "evader_radius": 0.14, "u_max": 4.0, "v_d_max": 1.0, "input_levels": 3}
ARMS = {  # the problem, and cells on which its sets grow
    "chased": (lambda: sdhj.arm_case_study(**SMALL | {"v_p_max": 0.9}), (32, 32, 8, 8)),
    "printed": (lambda: sdhj.arm_case_study(**SMALL | AMONG | {"kinematics": "printed"}), (63, 63, 24, 24)),
    "fleeing": (lambda: sdhj.evader_case_study(nodes=9, steps=2, **FLEES), (63, 63, 24, 24)),
}


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_is_proved_and_with_more_inputs_it_is_not(name, tmp_path):
    problem, cells = ARMS[name]
    table = sdhj.solve(problem(), sdhj.Certified(cells, parts=4), progress=False)
    table.save(path := tmp_path / "arm.npz")
    few = {"samples": None if name == "chased" else 100, "progress": False}
    if name == "chased":
        sdhj.export_c(table, tmp_path / "c", progress=False)
        few["exported"] = tmp_path / "c"
    verdict = verify(path, **few)
    assert verdict.ok, str(verdict)
    made = {claim.name: claim.made for claim in verdict.claims}
    added = [table.bits(start=k, within=1) & ~table.bits(start=k, within=0) for k in (0, 1)]
    assert made["one step nearer, within 1"] == np.sum(added) > 100
    assert made["clear of the obstacles"] == table.proof.motion.allowed.sum()
    again = sdhj.load(path)
    assert again.axes == table.axes and dict(again.details) == dict(table.details)
    assert all(np.array_equal(again.bits(start=0, within=n), table.bits(start=0, within=n)) for n in range(3))
    with forged(path) as (_, arrays):
        arrays["allowed"].fill(255)
    assert "clear of the obstacles" in str(verify(path, **few)).split("NOT proved")[0].splitlines()[-1]

"""Makes the small certified tables of arms in tests/data, which the checker's tests verify as plain Python.

python tests/make_arms.py
"""

from dataclasses import replace
from pathlib import Path

import sdhj
from sdhj.certified.export import FIELDS, packed_table

FOLDER = Path(__file__).parent / "data"
COMMON = {"nodes": 21, "delta": 0.25, "half_width": 0.01}
CHASED = {  # the target and an obstacle move, and sets grow with each of three steps to go
    "steps": 3,
    "input_levels": 2,
    "lengths": (0.17, 0.08),
    "u_max": 4.5,
    "v_d_max": 0.11,
    "v_p_max": 0.24,
    "pursuer_radius": 0.02,
    "pursuer_box": 0.5,
    "target": {"radius": 0.28, "path": {"kind": "line", "start": [-0.05, 0.14], "velocity": [0.1, -0.05]}},
    "obstacles": [
        {"radius": 0.03, "path": {"kind": "still", "centre": [-0.19, -0.18]}},
        {
            "radius": 0.04,
            "path": {"kind": "circle", "centre": [-0.17, -0.02], "radius": 0.05, "rate": 2.0, "phase": -1.0},
        },
    ],
}
FLEEING = {  # nothing depends on time; inputs are held late, and the controller remembers
    "steps": 2,
    "input_levels": 3,
    "kinematics": "printed",
    "lengths": (0.05, 0.06),
    "u_max": 4.4,
    "v_d_max": 0.23,
    "v_e_max": 0.11,
    "evader_radius": 0.21,
    "evader_box": 0.11,
    "obstacles": [{"radius": 0.03, "path": {"kind": "still", "centre": [0.12, -0.05]}}],
}
SENSING = sdhj.Sensing(error=[0.01, 0.02, 0.003, 0.002], jitter=0.005, memory=True)
CELLS = {"chased": (7, 5, 13, 5), "fleeing": (7, 9, 6, 5)}  # of the agent more and fewer than a word has bits


def made(name):
    """A certified table, and the bytes of its export."""
    if name == "chased":
        problem = sdhj.arm_case_study(**COMMON, **CHASED)
    else:
        problem = replace(sdhj.evader_case_study(**COMMON, **FLEEING), sensing=SENSING)
    table = sdhj.solve(problem, sdhj.Certified(cells=CELLS[name], parts=4), play=False, progress=False)
    return table, packed_table(table, FIELDS, "deepest", 0, False)


if __name__ == "__main__":
    for name in CELLS:
        table, words = made(name)
        table.save(FOLDER / f"{name}.npz")
        (FOLDER / f"{name}.bin").write_bytes(words)

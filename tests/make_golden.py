"""Makes tests/data/golden_6.npz: a small table in format 6, which later versions read too, or say that they do not.

python tests/make_golden.py
"""

from pathlib import Path

import numpy as np

import sdhj

FILE = Path(__file__).parent / "data" / "golden_6.npz"


def golden():
    """A robot with a look-up, a swept set, and a disturbance that does not enter linearly; plain constants."""
    stairs = sdhj.gridded(np.array([0.75, 0.5, -0.25]), [-1.0], [1.0])

    def velocity(q, u, v, t):
        return np.stack([u[0] - 0.25 * v[0] * v[0] * q[:, 1], u[1] + 0.125 * v[0] + 0.0625 * t + 0 * q[:, 0]], axis=1)

    def post(p, t):
        return np.hypot(p[:, 0] - 0.5 + 0.2 * t, p[:, 1] - 1.0) - 0.4

    def swept(p, t0, t1):
        nearest = np.clip(p[:, 0], 0.5 - 0.2 * t1, 0.5 - 0.2 * t0)
        return np.hypot(p[:, 0] - nearest, p[:, 1] - 1.0) - 0.4

    return sdhj.ReachAvoidProblem(
        grid=sdhj.Grid([-1.0, 0.0], [1.0, 2.0], [11, 9], names=["x", "y"], ends="wall"),
        dynamics=sdhj.Dynamics([[-0.5, 0.0], [0.5, 0.0]], velocity=velocity, bounds=[0.25]),
        target=sdhj.TargetSet((0,), lambda p, t: abs(p[:, 0] + 0.5) - 0.25),
        unsafe=[
            sdhj.UnsafeSet((0, 1), post, swept, name="post", sampling="steep"),
            sdhj.UnsafeSet((0,), lambda p, t: stairs(p), name="stairs"),
        ],
        delta=0.25,
        steps=2,
        name="golden",
    )


if __name__ == "__main__":
    sdhj.solve(golden(), progress=False, play=False).save(FILE)

"""A reference for the two aircraft: the collision tube of continuous time by hj_reachability, the same nodes.

    pip install -e '.[bench]' && python tests/make_air3d.py

writes tests/data/air3d.npz, with which tests/figures/test_safety_examples.py compares.
"""

from pathlib import Path

import numpy as np

FILE = Path(__file__).parent / "data" / "air3d.npz"
HORIZON, NODES = 2.8, (51, 40, 50)


def peer_values():
    """Level-set function of the unsafe states at NODES, float32, <= 0 where the pursuer wins: WENO5 and third-order RK.

    At the ends of the grid the peer extrapolates; what it finds unsafe does not come near them.
    """
    import hj_reachability as hj
    import jax.numpy as jnp

    box = hj.sets.Box(np.array([-6.0, -10.0, 0.0]), np.array([20.0, 10.0, 2 * np.pi]))
    grid = hj.Grid.from_lattice_parameters_and_boundary_conditions(box, NODES, periodic_dims=2)
    disk = jnp.linalg.norm(grid.states[..., :2], axis=-1) - 5.0
    tube = hj.solver.backwards_reachable_tube
    settings = hj.SolverSettings.with_accuracy("very_high", hamiltonian_postprocessor=tube)
    return np.asarray(hj.step(settings, hj.systems.Air3d(), grid, 0.0, disk, -HORIZON, progress_bar=False))


def stored():
    """The peer's set, bool of shape NODES."""
    with np.load(FILE) as data:
        return np.unpackbits(data["unsafe"], count=int(np.prod(NODES))).reshape(NODES).astype(bool)


if __name__ == "__main__":
    np.savez_compressed(FILE, unsafe=np.packbits(peer_values() <= 0))
    print(f"{FILE}: {FILE.stat().st_size} bytes, {stored().mean():.4f} of the nodes unsafe")

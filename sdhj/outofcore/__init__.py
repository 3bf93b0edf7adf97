"""Tables larger than memory: solved in slabs of the grid, kept in a Zarr store, looked up piece by piece.

Within one interval nothing travels farther than the differences of all its time steps reach, so a slab of the grid with
as many nodes beside it, its *halo*, is solved alone: `slabs` says how wide, and plays the games; `store` is where slabs
come from and go to; `solve` takes them through the recursion, here or on many machines; `table` answers from a store.
"""

from sdhj.outofcore.solve import solve_stored
from sdhj.outofcore.table import StoredTable, load_stored

__all__ = ["StoredTable", "load_stored", "solve_stored"]

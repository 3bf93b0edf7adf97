"""Comparing tables to the last bit, as of a solve on disk and one in memory."""

import numpy as np


def assert_bit_equal(stored, table) -> None:
    """A table has every bit of another."""
    for part, whole in ((stored, table), (stored.avoid, table.avoid)):
        for name in (
            ("index", "tubes", "marks") if part is stored else ("static_axes", "static", "moving_axes", "moving")
        ):
            one, other = (np.asarray(getattr(of, name)) for of in (part, whole))
            assert (one.dtype, one.shape) == (other.dtype, other.shape), name
            assert one.tobytes() == other.tobytes(), name

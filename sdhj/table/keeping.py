"""What a table keeps of its solve for the next one: `sdhj.resolve`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

from sdhj.kernels import FloatArray

Meaning = tuple[Any, ...]  # a key of what something computes


@dataclass(frozen=True, eq=False)
class Kept:
    """Parts of a solve that a table keeps for the next one, in this process only: elsewhere other bits may be computed.

    method : the object by which it was solved.
    each : by what it is of, the avoid tubes of one unsafe set, (L, *subgrid) at each step, where there are several.
    still : by step and within, solutions of the PDE in the moving frame.
    """

    method: object
    each: Mapping[Meaning, Sequence[FloatArray]] = field(default_factory=dict)
    still: Mapping[tuple[int, int], FloatArray] = field(default_factory=dict)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled, it is None: another process may round otherwise."""
        return type(None), ()

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that are kept."""
        return sum(one.nbytes for one in chain(*self.each.values(), self.still.values()))

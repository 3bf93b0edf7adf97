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

    Attributes
    ----------
    method : Method
        The object by which it was solved; None if nothing was kept.
    avoid_tubes_by_danger : mapping
        By a key of all that they depend on (`Former.key`), the avoid tubes of each unsafe set alone: (L, *subgrid) for
        each step. Empty where there is one set, whose tubes the table has.
    frame_solutions : mapping
        By (step, within), the solution of the PDE in the moving frame, before it is shifted by what each input does.
    """

    method: object
    avoid_tubes_by_danger: Mapping[Meaning, Sequence[FloatArray]] = field(default_factory=dict)
    frame_solutions: Mapping[tuple[int, int], FloatArray] = field(default_factory=dict)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled and loaded it is None, as another process may round otherwise."""
        return type(None), ()

    @property
    def nbytes(self) -> int:
        """Bytes of the arrays that are kept."""
        return sum(one.nbytes for one in chain(*self.avoid_tubes_by_danger.values(), self.frame_solutions.values()))

"""The ends of bounded axes: what becomes of a state that would pass them."""

from dataclasses import dataclass
from typing import Literal

Fate = Literal["fails", "holds", "frees"]


@dataclass(frozen=True)
class End:
    """A kind of end, with one fate for a state that would pass it; `ENDS` has all kinds by name.

    Attributes
    ----------
    name : str
        What users type, and files contain: "unsafe", "wall" or "safe".
    fails : bool
        Whether a state beyond has failed: what lies beyond is an unsafe set, with an avoid tube of its own.
    holds : bool
        Whether no state gets beyond: states, and the boxes around them, are clipped at the end, and a function on the
        grid has beyond it the value that it has at it.
    frees : bool
        Whether a state beyond is out of danger for good: games are played on nodes past the end, where values are below
        0.
    """

    name: str
    fails: bool = False
    holds: bool = False
    frees: bool = False


ENDS = {end.name: end for end in (End("unsafe", fails=True), End("wall", holds=True), End("safe", frees=True))}

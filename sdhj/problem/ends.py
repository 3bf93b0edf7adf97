"""The ends of bounded axes: what becomes of a state that would pass one."""

from dataclasses import dataclass
from typing import Literal

Fate = Literal["fails", "holds", "frees"]


@dataclass(frozen=True)
class End:
    """A kind of end, by the name that users type and files contain.

    fails : a state beyond has failed: what lies there is an unsafe set, with an avoid tube of its own.
    holds : no state gets beyond: points, and the boxes around them, are clipped at the end, and values at nodes go on
        past it as they are at it.
    frees : a state beyond is out of danger for good: games are played on nodes past the end, where values are below 0.
    """

    name: str
    fails: bool = False
    holds: bool = False
    frees: bool = False


ENDS = {end.name: end for end in (End("unsafe", fails=True), End("wall", holds=True), End("safe", frees=True))}

"""What becomes of a state that would pass the end of a bounded axis."""

from dataclasses import dataclass
from typing import Literal

Fate = Literal["fails", "holds", "frees"]


@dataclass(frozen=True)
class End:
    """A kind of end, with one fate for a state that would pass it."""

    name: str  # what users type, and files contain: "unsafe", "wall" or "safe"
    # Whether a state beyond has failed: what lies beyond is an unsafe set, with an avoid tube of its own.
    fails: bool = False
    # Whether no state gets beyond: states, and the boxes around them, are clipped at the end, where a function on the
    # grid has the value for beyond.
    holds: bool = False
    # Whether a state beyond is out of danger for good: games are played on nodes past the end, with values below 0.
    frees: bool = False


ENDS = {end.name: end for end in (End("unsafe", fails=True), End("wall", holds=True), End("safe", frees=True))}

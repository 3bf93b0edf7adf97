"""What a solve costs, which is counted by a model before it begins, and how far it has come.

An *operation* is what one stage of a PDE, or one look at a neighbour for a maximum, does to one node for one input: it
takes a core some 3 ns (`figures/bench.py` measures what a second buys). A solve takes so many of them:

    tubes x (reach games + marks) + avoid games,

with N tubes where nothing depends on time, and N (N + 1) / 2 where anything does: each step then has its own, for each
number of steps to go. A game takes nodes x inputs x time steps x stages; there are as many time steps as the CFL
condition asks for, a number that grows with the cells that the state crosses in an interval.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, NamedTuple

MOST_OPERATIONS = 1e13  # some hours on two cores
CALL = 10_000.0  # operations that take as long as calling a kernel does
ENDLESS_STEPS = 100  # steps that are counted where a problem has no number of steps


class Cost(NamedTuple):
    """What a solve costs, by a model: see `sdhj.problem.cost`.

    Attributes
    ----------
    operations : float
        Of the whole solve. Of a problem without a number of steps: of 100 of them.
    nbytes : int
        Upper estimate of the memory at its peak, in bytes.
    tubes : int
        How many are solved.
    once : float
        Operations before the first tube: avoid games.
    crossed : float
        How many cells the state crosses in an interval, at most, along all axes together.
    why : str
        What multiplies what, in words.
    """

    operations: float
    nbytes: int
    tubes: int
    once: float
    crossed: float
    why: str

    def __str__(self) -> str:
        return f"{self.operations:.2g} operations and {self.nbytes / 1e9:.2g} GB of memory: {self.why}"


class Meter:
    """What is told of a solve while it runs: `begin`, then `tick` as often as you like, and `tube` after each tube.

    most : operations that are allowed.
    bar : a progress bar, as of tqdm, in operations.
    """

    def __init__(self, most: float, bar: Any, only_stated: bool = False) -> None:
        self.most, self.bar, self.only_stated = most, bar, only_stated
        self.cost: Cost | None = None
        self.each, self.until, self.at = 0.0, 0.0, 0.0

    def begin(self, cost: Cost, endless: bool) -> None:
        """State the cost; ValueError if it is more than is allowed."""
        self.cost = cost
        if self.only_stated:
            raise Stated
        if cost.operations > self.most:
            raise ValueError(
                f"this solve takes about {cost.operations:.1e} operations, and {self.most:.1e} are allowed (1e13 are "
                f"some hours on two cores): in an interval the state crosses up to {cost.crossed:,.0f} cells, and there "
                f"are {cost.why}. Check the units of delta and of velocities, use a shorter "
                f"delta or fewer nodes, or allow more by solve(..., operations={1.1 * cost.operations:.1e})"
            )
        self.each, self.until = (cost.operations - cost.once) / max(cost.tubes, 1), cost.once
        if not endless:
            self.bar.reset(total=round(cost.operations))
        self.bar.set_postfix_str(f"{cost.tubes:,} tubes, {cost.nbytes / 1e9:.2g} GB")

    def tick(self, operations: float) -> None:
        """So many operations are done, of the avoid games or of the tube at hand: as much of it as was counted."""
        if (more := min(operations, self.until - self.at)) > 0:
            self.at += more
            self.bar.update(more)

    def tube(self) -> None:
        """What was counted so far is done, and the next tube begins."""
        self.tick(self.until - self.at)
        self.until += self.each


class Stated(Exception):
    """The cost is stated, and no more was asked for."""


METER: ContextVar[Meter | None] = ContextVar("METER", default=None)


@contextmanager
def metered(meter: Meter) -> Iterator[Meter]:
    """What is solved within tells the meter."""
    token = METER.set(meter)
    try:
        yield meter
    finally:
        METER.reset(token)


def begin(cost: Callable[[], Cost | None], endless: bool = False) -> None:
    """Tell the meter what a solve costs, if there is one that asks, and the model knows."""
    if (meter := METER.get()) is not None and (found := cost()) is not None:
        meter.begin(found, endless)


def tick(operations: float) -> None:
    """Tell the meter of operations that were done."""
    if (meter := METER.get()) is not None:
        meter.tick(operations)

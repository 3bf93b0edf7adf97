"""What a solve costs, which is counted by a model before it begins, and how far it has come.

An *operation* is what one stage of a PDE, or four reads of neighbours for a maximum, do to one node for one input: it
takes a core 0.5 to 3 ns (`figures/bench.py` measures what a second buys). A solve takes so many of them:

    tubes x (reach games + marks) + avoid games,

with N tubes where nothing depends on time, and N (N + 1) / 2 where anything does: each step then has its own, for each
number of steps to go. A game takes nodes x inputs x time steps x stages; there are as many time steps as the CFL
condition asks for, a number that grows with the cells that the state crosses in an interval.
"""

import math
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any, NamedTuple

from tqdm import tqdm

MOST_OPERATIONS = 1e13  # some hours on two cores
CALL = 10_000.0  # operations that take as long as calling a kernel does
ENDLESS_STEPS = 100  # steps that are counted where a problem has no number of steps


class Cost(NamedTuple):
    """The cost of a solve by a model: see `sdhj.problem.cost`.

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
    disk : int
        Bytes that a store takes on its disk, at most.
    """

    operations: float
    nbytes: int
    tubes: int
    once: float
    crossed: float
    why: str
    disk: int = 0

    def __str__(self) -> str:
        """Operations, memory and what makes it so, in a line."""
        return f"{self.operations:.2g} operations and {self.nbytes / 1e9:.2g} GB of memory: {self.why}"


class Stated(Exception):
    """Raised by a meter with `only_stated`, as soon as it knows the cost: no more was asked for."""


class Meter:
    """The progress of a solve, which calls `begin`, then `tick` as often as it likes, and `tube` after each tube.

    A progress bar shows it, in operations; in tubes where the method does not say what it costs. `with` makes it the
    one that `begin` and `tick` of this module tell.

    name : of the bar.
    hidden : whether there is none.
    most : operations that are allowed.
    only_stated : whether the solve ends where it would begin, with `Stated`.
    """

    def __init__(self, name: str, hidden: bool, most: float = math.inf, only_stated: bool = False) -> None:
        """A meter of the method `name`, that shows no bar if `hidden` and refuses more than `most` operations;
        see the class.
        """
        self.name, self.hidden, self.most, self.only_stated = name, hidden, most, only_stated
        self.cost: Cost | None = None
        self.bar: Any = None
        self.each, self.until, self.at = 1, 0, 0

    def __enter__(self) -> "Meter":
        """Make it the meter that solves in this context tell; returns it."""
        self.token = METER.set(self)
        return self

    def __exit__(self, *error: Any) -> None:
        """Restore the meter before it, and close the bar."""
        METER.reset(self.token)
        if self.bar is not None:
            self.bar.close()

    def begin(self, cost: Cost | None, endless: bool) -> None:
        """Note the cost and show the bar; raise `Stated` if no more was asked for, ValueError if it is more than is
        allowed.

        cost : None if it is not known; the bar then counts tubes. endless : whether the number of tubes is not known,
            so that the bar has no end.
        """
        self.cost = cost
        if self.only_stated:
            raise Stated
        if cost is None:
            self.bar = tqdm(desc=self.name, unit="tube", disable=self.hidden)
            return
        if cost.operations > self.most:
            raise ValueError(
                f"this solve takes about {cost.operations:.1e} operations, and {self.most:.1e} are allowed (1e13 are "
                f"some hours on two cores): in an interval the state crosses up to {cost.crossed:,.0f} cells, and "
                f"there are {cost.why}. Check the units of delta and of velocities, use a shorter delta or fewer "
                f"nodes, or allow more by --operations or solve(..., operations={1.1 * cost.operations:.1e})"
            )
        self.until = round(cost.once)  # whole numbers, which add up
        self.each = round((cost.operations - cost.once) / max(cost.tubes, 1))
        total = None if endless else self.until + cost.tubes * self.each
        self.bar = tqdm(desc=self.name, total=total, unit="op", unit_scale=True, disable=self.hidden)
        disk = f" and {cost.disk / 1e9:.2g} GB on disk" if cost.disk else ""
        self.bar.set_postfix_str("" if endless else f"{cost.tubes:,} tubes, at most {cost.nbytes / 1e9:.2g} GB{disk}")

    def tick(self, operations: float) -> None:
        """Move the bar by so many operations that are done, of the avoid games or of the tube at hand: no further than
        was counted for these.
        """
        if (more := min(round(operations), self.until - self.at)) > 0:
            self.at += more
            self.bar.update(more)

    def tube(self) -> None:
        """Move the bar to the end of all that was counted so far, and let the next tube begin; without a cost it
        shows tubes.
        """
        if self.bar is None:  # of sets that state nothing
            self.begin(None, True)
        self.tick(self.until - self.at)
        self.until += self.each


def multiplied(problem: Any, tubes: int, size: int, what: str) -> str:
    """A phrase that says why a solve takes long: so many tubes of `size` nodes or cells (`what`) for so many inputs,
    and what makes the tubes so many.
    """
    moving = [repr(part.name) for part in problem.all_sets if part.moving]
    moving += ["the dynamics"] * problem.dynamics.timed
    depends = moving[0] + (f" and {len(moving) - 1} more depend" if moving[1:] else " depends") if moving else ""
    why = f" (N (N + 1) / 2 in place of N = {problem.steps:,}, because {depends} on time)" if moving else ""
    return f"{tubes:,} tubes{why} of {size:,} {what} for {len(problem.inputs)} inputs"


METER: ContextVar[Meter | None] = ContextVar("METER", default=None)


def begin(cost: Callable[[], Cost | None], endless: bool = False) -> None:
    """Tell the meter of this context, if there is one, what a solve costs: `cost()`, which is called only then.
    endless : whether it has no number of steps. Raises what `Meter.begin` does.
    """
    if (meter := METER.get()) is not None:
        meter.begin(cost(), endless)


def tick(operations: float) -> None:
    """Tell the meter of this context, if there is one, of operations that are done."""
    if (meter := METER.get()) is not None:
        meter.tick(operations)

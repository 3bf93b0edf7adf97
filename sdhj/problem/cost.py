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
    """The cost of a solve, by a model, before it begins; the module says how operations are counted.

    Attributes
    ----------
    operations : float
        Of the whole solve. Of a problem without a number of steps: of `ENDLESS_STEPS` = 100 of them.
    nbytes : int
        Upper estimate of the memory at its peak, in bytes.
    tubes : int
        How many are solved.
    once : float
        Operations before the first tube: avoid games.
    crossed : float
        How many cells the state crosses in an interval, at most, along all axes together.
    why : str
        What multiplies what, in words, from `multiplied`.
    disk : int
        Bytes that a store takes on its disk, at most; 0 in memory.
    """

    operations: float
    nbytes: int
    tubes: int
    once: float
    crossed: float
    why: str
    disk: int = 0

    def __str__(self) -> str:
        """One line: operations, memory, and `why`."""
        return f"{self.operations:.2g} operations and {self.nbytes / 1e9:.2g} GB of memory: {self.why}"


class Stated(Exception):
    """Raised by `Meter.begin` to end a solve before it begins, where only the cost was asked for (`only_stated`)."""


class Meter:
    """The progress of one solve, shown as a bar.

    Who solves calls `begin` once, `tick` at will, and `tube` after the avoid games and after each tube. `with meter:`
    makes it the meter of this context, to which this module's functions `begin` and `tick` pass their calls; at the end
    of the context the bar is closed. The bar shows operations, or tubes where the cost is not known.

    Attributes
    ----------
    name : str
        Of the method, before the bar.
    hidden : bool
        Whether no bar is shown.
    most : float
        Operations that are allowed.
    only_stated : bool
        Whether `begin` ends the solve with `Stated`.
    cost : Cost or None
        As `begin` was told.
    bar : tqdm or None
        None before `begin`.
    each : int
        Operations that are counted for one tube.
    until : int
        Operations that are counted up to the end of the tube at hand; at first, to that of the avoid games.
    at : int
        Operations that the bar shows.
    """

    def __init__(self, name: str, hidden: bool, most: float = math.inf, only_stated: bool = False) -> None:
        """A meter that has not begun.

        name : of the method, before the bar. hidden : whether no bar is shown. most : operations that are allowed.
        only_stated : whether `begin` ends the solve with `Stated`, because only the cost is asked for.
        """
        self.name, self.hidden, self.most, self.only_stated = name, hidden, most, only_stated
        self.cost: Cost | None = None
        self.bar: Any = None
        self.operations_per_tube, self.until, self.at = 1, 0, 0

    def __enter__(self) -> "Meter":
        """Make it the meter of this context; returns it."""
        self.token = METER.set(self)
        return self

    def __exit__(self, *error: Any) -> None:
        """Make the meter that was there before that of this context again, and close the bar."""
        METER.reset(self.token)
        if self.bar is not None:
            self.bar.close()

    def begin(self, cost: Cost | None, endless: bool) -> None:
        """Keep the cost in the attribute `cost`, and show the bar.

        cost : None if it is not known; the bar then counts tubes, and nothing is refused. endless : whether the number
        of tubes is not known, so that the bar has no end.

        Raises `Stated` if the meter was made for the cost only, and ValueError, with advice, if the solve would take
        more operations than are allowed.
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
        self.operations_per_tube = round((cost.operations - cost.once) / max(cost.tubes, 1))
        total = None if endless else self.until + cost.tubes * self.operations_per_tube
        self.bar = tqdm(desc=self.name, total=total, unit="op", unit_scale=True, disable=self.hidden)
        disk = f" and {cost.disk / 1e9:.2g} GB on disk" if cost.disk else ""
        self.bar.set_postfix_str("" if endless else f"{cost.tubes:,} tubes, at most {cost.nbytes / 1e9:.2g} GB{disk}")

    def tick(self, operations: float) -> None:
        """Move the bar by operations that are done, of the avoid games or of the tube at hand.

        The bar never moves past what was counted for these, so ticks before `begin`, and without a cost, do nothing.
        """
        if (more := min(round(operations), self.until - self.at)) > 0:
            self.at += more
            self.bar.update(more)

    def tube(self) -> None:
        """Note that the avoid games, or a tube, are done: move the bar to the end of what was counted for them.

        Ticks that follow belong to the next tube. Where the cost is not known, the bar counts the tubes; where `begin`
        was not called, it is called here, without a cost.
        """
        if self.bar is None:  # of sets that state nothing
            self.begin(None, True)
        self.tick(self.until - self.at)
        self.until += self.operations_per_tube


def multiplied(problem: Any, tubes: int, size: int, what: str) -> str:
    """The words of `Cost.why`: how many tubes of how many nodes for how many inputs, and what makes the tubes so many.

    problem : a ReachAvoidProblem. tubes : how many are solved. size : nodes or cells of one tube. what : "nodes" or
    "cells".
    """
    moving = [repr(part.name) for part in problem.all_sets if part.moving]
    moving += ["the dynamics"] * problem.dynamics.depends_on_time
    depends = moving[0] + (f" and {len(moving) - 1} more depend" if moving[1:] else " depends") if moving else ""
    why = f" (N (N + 1) / 2 in place of N = {problem.steps:,}, because {depends} on time)" if moving else ""
    return f"{tubes:,} tubes{why} of {size:,} {what} for {len(problem.inputs)} inputs"


METER: ContextVar[Meter | None] = ContextVar("METER", default=None)


def begin(cost: Callable[[], Cost | None], endless: bool = False) -> None:
    """Call `Meter.begin` of this context's meter with cost() and `endless`; without a meter do nothing, nor call cost.

    cost : returns the `Cost`, or None if it is not known. endless : whether the problem has no number of steps. Raises
    what `Meter.begin` does.
    """
    if (meter := METER.get()) is not None:
        meter.begin(cost(), endless)


def tick(operations: float) -> None:
    """Call `Meter.tick` of this context's meter with operations that are done; without a meter do nothing."""
    if (meter := METER.get()) is not None:
        meter.tick(operations)

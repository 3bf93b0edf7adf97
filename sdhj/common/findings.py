"""Findings: what a user should know of a problem or a table beside its answers. All are warned of by `tell`."""

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import NamedTuple

PACKAGE = str(Path(__file__).parents[1])


class ResolutionWarning(UserWarning):
    """The grid is too coarse for an unsafe set, its level-set function is not a distance, or many runs are lost.

    Examples
    --------
    With the robot on a line of `help(sdhj)`, to make an error of what would be told:

    >>> import warnings
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", sdhj.ResolutionWarning)
    ...     fine = sdhj.solve(problem)
    """


class UnsettledWarning(UserWarning):
    """The sets of a problem without a number of steps were still changing when the solve ended.

    What is promised then holds for as many steps as were solved. More cells or a longer delta help.

    Examples
    --------
    >>> import sdhj
    >>> issubclass(sdhj.UnsettledWarning, UserWarning)
    True
    """


class ProjectionWarning(UserWarning):
    """The projected method finds little or nothing with these subspaces.

    The target depends on an axis that is dropped: keep it (`sdhj.Projected(subspaces=...)`), or use method "hji".

    Examples
    --------
    An evader cannot be projected:

    >>> import sdhj
    >>> import warnings
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     found = sdhj.solve(sdhj.evader_case_study(nodes=9, steps=1), "projected")
    >>> sdhj.ProjectionWarning in [one.category for one in caught]
    True
    """


class Finding(NamedTuple):
    """Something to be warned of by `tell`; str() is the sentence that the user reads."""

    cause: str  # what is wrong, with a number: the begin of the sentence
    number: float  # how much of it, in the unit that the cause names
    remedy: str  # what helps: the rest of the sentence, with the separator before it
    kind: type[UserWarning] = ResolutionWarning

    def __str__(self) -> str:
        return self.cause + self.remedy


# of each thread and task its own, as several may solve at the same time
_FOUND = ContextVar[list[Finding] | None]("found", default=None)


@contextmanager
def findings() -> Iterator[list[Finding]]:
    """A context whose value is a list, to which `tell` appends each finding; users are warned all the same."""
    found: list[Finding] = []
    # Those of a context around this one are not told: `tell` appends to the innermost.
    token = _FOUND.set(found)
    try:
        yield found
    finally:
        _FOUND.reset(token)


def tell(*some: Finding | None) -> None:
    """Warn of each finding that is not None, and append it to the list of the innermost context of `findings`.

    Where the user has made errors of such warnings, the first is raised.
    """
    frame, level, found = sys._getframe(1), 2, _FOUND.get()
    # the warning points at the line of the user's code that called the package
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        frame, level = frame.f_back, level + 1
    for finding in filter(None, some):
        if found is not None:
            found.append(finding)
        warnings.warn(str(finding), finding.kind, stacklevel=level)

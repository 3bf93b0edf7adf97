"""Kernels as the plain Python that they are: a dimension or an order that nothing else needs is then not compiled."""

import sys

import pytest
from numba.core.dispatcher import Dispatcher

from sdhj.kernels.compiling import Shared


def run_plainly(monkeypatch: pytest.MonkeyPatch, room: str = "sdhj") -> None:
    """Have every kernel of the package, or of a room, run uncompiled, where it stands and where it has been imported.

    The same functions do the same operations, node by node: for a few hundred nodes.
    """
    for module in [module for name, module in sys.modules.items() if f"{name}.".startswith(f"{room}.")]:
        for name, value in list(vars(module).items()):
            if isinstance(value, Shared | Dispatcher):
                monkeypatch.setattr(module, name, value.py_func)

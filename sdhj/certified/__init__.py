"""Sets with a proof, and their independent checker.

Nothing is imported before it is asked for: `sdhj.certified.check` stands alone.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sdhj.certified.bounds import LipschitzBounds
    from sdhj.certified.sets import Certified
    from sdhj.certified.table import CertifiedTable

_MODULES = {
    "Certified": "sdhj.certified.sets",
    "CertifiedTable": "sdhj.certified.table",
    "LipschitzBounds": "sdhj.certified.bounds",
}
__all__ = ["Certified", "CertifiedTable", "LipschitzBounds"]


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'sdhj.certified' has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULES[name]), name)

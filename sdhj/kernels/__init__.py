"""All compiled code, and how it is compiled; it imports nothing of the rest."""

from typing import Any

from numpy.typing import NDArray

FloatArray = NDArray[Any]

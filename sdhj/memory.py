"""How much memory is free, asked before anything large is made."""

from decimal import Decimal
from pathlib import Path


def available() -> int | None:
    """Bytes that programs can still take, or None where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration):
        return None


def require(needed: int, what: str, remedy: str = "use fewer nodes") -> None:
    """Raise MemoryError where `what` needs more bytes than are available."""
    free = available()
    if free is not None and needed > free:
        told = [f"{Decimal(size) / 10**9:.3g}" for size in (needed, free)]  # `needed` may be more than a float holds
        raise MemoryError(f"{what} needs about {told[0]} GB, and {told[1]} GB are available; {remedy}")

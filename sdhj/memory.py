"""How much memory is free, asked before anything large is made."""

import os
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

try:
    import resource
except ImportError:  # where there are no such limits
    resource = None  # type: ignore[assignment]

SPARE = 2**22  # bytes for which there is always room: to ask takes as long as to fill them
# of each version of control groups: where they stand, the limit, what is used, and what of that is given back at need
GROUPS = {
    2: ("", "memory.max", "memory.current", "inactive_file"),
    1: ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}


def available() -> tuple[int, str] | None:
    """Bytes that this process can still take and what sets the limit, or None where the system does not say."""
    return min([*_of_machine(), *_of_process(), *of_control_groups()], default=None)


def _of_machine() -> Iterator[tuple[int, str]]:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return
    yield from ((1024 * int(line.split()[1]), "are available") for line in lines if line.startswith("MemAvailable"))


def _of_process() -> Iterator[tuple[int, str]]:
    try:
        limit = resource.RLIM_INFINITY if resource is None else resource.getrlimit(resource.RLIMIT_AS)[0]
        used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, AttributeError):
        return
    if limit != resource.RLIM_INFINITY:
        yield max(limit - used, 0), f"are left of the {Decimal(limit) / 10**9:.3g} GB of address space (ulimit -v)"


def of_control_groups(
    root: Path = Path("/sys/fs/cgroup"), own: Path = Path("/proc/self/cgroup")
) -> Iterator[tuple[int, str]]:
    """What the control groups of this process and those above them leave; a container sees its own as the root."""
    try:
        told = [line.split(":", 2) for line in own.read_text(encoding="utf-8").splitlines()]
    except OSError:
        return
    for _, kinds, path in told:
        if kinds and "memory" not in kinds.split(","):
            continue
        mount, *names = GROUPS[1 if kinds else 2]
        group = root / mount / path.lstrip("/")
        for folder in (group, *group.parents):
            try:
                limit, used, stat = (
                    (folder / name).read_text(encoding="ascii") for name in (*names[:2], "memory.stat")
                )
                kept = next((int(line.split()[1]) for line in stat.splitlines() if line.split()[0] == names[2]), 0)
                left = int(limit) - int(used) + kept
            except (OSError, ValueError):  # no such file, or no limit: "max"
                continue
            yield max(left, 0), f"are left of the {int(limit) / 1e9:.3g} GB of the control group {folder}"


def require(needed: int, what: str, remedy: str = "use fewer nodes") -> None:
    """Raise MemoryError where `what` needs more bytes than are available."""
    free = available() if needed > SPARE else None
    if free is not None and needed > free[0]:
        told = [f"{Decimal(size) / 10**9:.3g}" for size in (needed, free[0])]  # `needed` may be more than a float holds
        raise MemoryError(f"{what} needs about {told[0]} GB, and {told[1]} GB {free[1]}; {remedy}")

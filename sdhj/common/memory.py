"""How much memory is available, which is checked before large arrays are allocated."""

import os
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

SPARE = 2**22  # bytes that are never checked: a check takes as long as filling them
# for both versions of control groups: folder, limit, memory used, and the part of it that is reclaimed when needed
GROUPS = {
    False: ("", "memory.max", "memory.current", "inactive_file"),
    True: ("memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
}


def available() -> tuple[int, str] | None:
    """The fewest bytes that machine, process and control groups leave, and words on which; None where none says."""
    lines = [line.split() for line in _lines(Path("/proc/meminfo")) if line.startswith("MemAvailable")]
    machine = [(1024 * int(line[1]), "are available") for line in lines]
    return min([*machine, *of_process(), *of_control_groups()], default=None)


def of_process() -> Iterator[tuple[int, str]]:
    """Yield (bytes, words that name the limit) for what is left of this process's address space."""
    for line in _lines(Path("/proc/self/statm")):
        import resource  # exists on every system that has such a file

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            left = max(limit - int(line.split()[0]) * os.sysconf("SC_PAGE_SIZE"), 0)
            yield left, f"are left of the {limit / 1e9:.3g} GB of address space that ulimit -v allows"


def of_control_groups(
    root: Path = Path("/sys/fs/cgroup"), groups: Path = Path("/proc/self/cgroup")
) -> Iterator[tuple[int, str]]:
    """Yield (bytes left, words that name the group) for the process's control groups, and those above."""
    for line in _lines(groups):
        _, kinds, path = line.split(":", 2)
        mount, *names, given_back = GROUPS[kinds != ""]
        group = root / mount / path.lstrip("/")
        # a container sees its own group as the root
        for folder in (group, *group.parents) if kinds in ("", "memory") else ():
            limit, used = ("".join(_lines(folder / name)) for name in names)
            if limit.isdecimal() and used.isdecimal():  # else there is no such file, or no limit: "max"
                stat = dict(entry.split() for entry in _lines(folder / "memory.stat"))
                left = int(limit) - int(used) + int(stat.get(given_back, 0))  # with what the group can reclaim
                yield max(left, 0), f"are left of the {int(limit) / 1e9:.3g} GB of the control group {folder}"


def _lines(path: Path) -> list[str]:
    """The lines of a text file; [] where it cannot be read, as on another system."""
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError:  # no such file on this system
        return []


def require_memory(needed: int, what: str, remedy: str = "use fewer nodes") -> None:
    """Raise MemoryError, which ends with the remedy, if `what` needs more bytes than are `available`."""
    free = available() if needed > SPARE else None
    if free is not None and needed > free[0]:
        shown = [f"{Decimal(size) / 10**9:.3g}" for size in (needed, free[0])]  # may be more than a float holds
        raise MemoryError(f"{what} needs about {shown[0]} GB, but only {shown[1]} GB {free[1]}; {remedy}")

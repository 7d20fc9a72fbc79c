"""The memory that can be had: what the system has, and limits of containers and of the process."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

PROC, CONTROL_GROUPS = Path("/proc"), Path("/sys/fs/cgroup")
"""Where Linux tells of processes and of control groups; other systems have neither."""

_OF_VERSION = {
    1: ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"),
    2: ("memory.max", "memory.current", "inactive_file"),
}
"""Files of a control group with its limit and its use, and the part of the use that is given up when it is needed."""


def available() -> float:
    """Return the bytes of memory that can be had, infinite where nothing is known."""
    return max(0.0, min(_of_system(), _of_groups(), _of_process()))


def _of_system() -> float:
    """Return the memory of the machine that is free or can be made so, else what is built in."""
    found = _kilobytes(PROC / "meminfo", "MemAvailable:")
    if found is not None:
        return found
    try:
        return float(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):
        return math.inf


def _of_process() -> float:
    """Return what the limits of the process leave of its addresses and its data."""
    try:
        import resource
    except ImportError:  # no Unix
        return math.inf
    left = math.inf
    for limit, used in ((resource.RLIMIT_AS, "VmSize:"), (resource.RLIMIT_DATA, "VmData:")):
        most = resource.getrlimit(limit)[0]
        if most != resource.RLIM_INFINITY:
            left = min(left, most - (_kilobytes(PROC / "self" / "status", used) or 0.0))
    return left


def _of_groups() -> float:
    """Return what the limits of the control groups of the process leave, as those of containers and batch systems."""
    left = math.inf
    for version, folder in _groups():
        limit, used, file = _OF_VERSION[version]
        most = _number(folder / limit)
        if most is not None:
            kept = _listed(folder / "memory.stat", file)
            left = min(left, most - (_number(folder / used) or 0.0) + kept)
    return left


def _groups() -> Iterator[tuple[int, Path]]:
    """Yield the control groups of the process with all that they are in, and the version of their files.

    In a container the root is its own group, whatever the name that the process has for it.
    """
    for line in _text(PROC / "self" / "cgroup").splitlines():
        number, _, rest = line.partition(":")
        kinds, _, path = rest.partition(":")
        if number == "0" and not kinds:
            version, root = 2, CONTROL_GROUPS
        elif "memory" in kinds.split(","):
            version, root = 1, CONTROL_GROUPS / "memory"
        else:
            continue
        folder = root / path.strip("/")
        yield from ((version, item) for item in (folder, *folder.parents) if item.is_relative_to(root))


def _text(file: Path) -> str:
    """Return the text of a file, "" where there is none."""
    try:
        return file.read_text(encoding="ascii")
    except (OSError, ValueError):
        return ""


def _number(file: Path) -> float | None:
    """Return the number that a file holds, None where it holds none, such as "max"."""
    text = _text(file).strip()
    return float(text) if text.isdecimal() else None


def _listed(file: Path, name: str) -> float:
    """Return the number after a name in a file of such lines, else 0."""
    found = (line.split() for line in _text(file).splitlines())
    return next((float(words[1]) for words in found if len(words) > 1 and words[0] == name), 0.0)


def _kilobytes(file: Path, name: str) -> float | None:
    """Return the same for kilobytes, in bytes; None where it is not listed."""
    found = _listed(file, name)
    return 1024.0 * found if found else None

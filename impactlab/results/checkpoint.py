"""Folders that keep what is finished of a long computation, so that it goes on where it was stopped.

A folder holds what was asked for, and items: each is the result of one piece of the work, some seconds long, under a
name that follows from all that its numbers depend on. One process at a time works in a folder.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any, NamedTuple, TypeVar

import impactlab
from impactlab.errors import InvalidInput
from impactlab.results.arrays_file import load_arrays, save_arrays
from impactlab.results.dataset import replacing, told
from impactlab.results.plain_values import digest, plain_data

Made = TypeVar("Made")

ASKED, ITEMS, LOCKED = "asked.json", "items", ".lock"
"""Names of what a folder holds: what was asked for, the folder of items, and the file that its process has locked."""

ITEM = ".item"
"""How names of items end."""

DIFFERENCES = 3
"""Differences from what was asked for before that a refusal names."""

BETWEEN_STATES = 3.0
"""Time between two states of a long piece of work that are kept (s): little work is lost, and little time is spent."""

_claimed: set[Path] = set()
_of_claimed = threading.Lock()


class KeptItem(NamedTuple):
    """A file for the result of one piece of the work. Any process may hold it, since the name is all there is to it."""

    path: Path

    def load(self) -> Any:
        """Return what was kept, None where nothing was or it is damaged: it is then made again."""
        try:
            return load_arrays(self.path)
        except InvalidInput:
            return None

    def save(self, value: Any) -> None:
        """Keep something, whole or not at all."""
        save_arrays(value, self.path)

    def part(self, name: str) -> KeptItem:
        """Return the item of something in the midst of the work, such as a state."""
        return KeptItem(self.path.with_suffix(f".{name}"))

    def remove_parts(self) -> None:
        """Keep nothing of the midst of the work any more."""
        for path in self.path.parent.glob(f"{self.path.stem}.*"):
            if path != self.path:
                path.unlink(missing_ok=True)

    def remove(self) -> None:
        """Keep nothing any more."""
        self.path.unlink(missing_ok=True)


class Checkpoint:
    """A folder of items that this process works in.

    Parameters
    ----------
    path : Path
        It is made if it is not there.
    chosen : mapping
        What the first call has chosen, such as a seed, and later ones take over.
    """

    def __init__(self, path: Path, chosen: Mapping[str, Any]) -> None:
        self.path, self.chosen = path, chosen
        with told(str(path), path):
            path.mkdir(exist_ok=True)

    def __fspath__(self) -> str:
        return str(self.path)

    def item(self, key: str) -> KeptItem:
        """Return the item of a name, which a file can have."""
        return KeptItem(self.path / f"{key}{ITEM}")

    def paths(self, kind: str) -> list[Path]:
        """Return the files of all items whose names begin with a word and a hyphen."""
        return sorted(self.path.glob(f"{kind}-*{ITEM}"))

    def part(self, key: str) -> Checkpoint:
        """Return the checkpoint of a part of the computation, a folder in this one, to be cleared when it is done."""
        return Checkpoint(self.path / key, self.chosen)

    def clear(self) -> None:
        """Remove all that is kept."""
        shutil.rmtree(self.path, ignore_errors=True)


def made(item: KeptItem | None, function: Callable[..., Made], *arguments: Any) -> Made:
    """Return what a function returns, nested plain data, that an item has; else call the function and keep it."""
    if item is None:
        return function(*arguments)
    found = item.load()
    if found is None:
        found = [function(*arguments)]
        item.save(found)
    return found[0]  # type: ignore[no-any-return]


@contextlib.contextmanager
def checkpoint_in(
    folder: str | os.PathLike[str], asked: Mapping[str, Any], chosen: Callable[[], Mapping[str, Any]]
) -> Iterator[Checkpoint]:
    """Work in a folder, which must be new, or of a call that asked for the same.

    What is asked for is plain data, components and networks; `chosen` returns what only a first call chooses.
    """
    path = _folder(folder)
    now = json.loads(json.dumps({"versions": versions(), **plain_data(asked)}))
    with locked(path):
        before = _asked_before(path)
        if before is None:
            before = {"asked": now, "chosen": plain_data(chosen())}
            _write(path / ASKED, json.dumps({**before, "digest": _digest_of(before)}, indent=1).encode())
        elif different := list(_differences(before["asked"], now)):
            more = f", and {len(different) - DIFFERENCES} more" if len(different) > DIFFERENCES else ""
            raise InvalidInput(
                f"checkpoint: {path} keeps what another call has found: {'; '.join(different[:DIFFERENCES])}{more}. "
                "Repeat that call, or give another folder."
            )
        for file in path.rglob(".*.tmp"):  # of processes that were killed while they wrote
            file.unlink(missing_ok=True)
        yield Checkpoint(path / ITEMS, before["chosen"])


def versions() -> dict[str, str]:
    """Return the versions of all that the bits of numbers depend on."""
    return {"impactlab": impactlab.__version__} | {name: version(name) for name in ("numpy", "scipy", "numba")}


def _folder(folder: Any) -> Path:
    """Return a folder that is there and empty, or a checkpoint; refuse what is none."""
    if not isinstance(folder, str | os.PathLike) or not os.fspath(folder):
        raise InvalidInput(f"checkpoint is the path of a folder, not {folder!r}.")
    path = Path(folder).absolute()
    if path.exists() and not path.is_dir():
        raise InvalidInput(f"checkpoint: {path} is a file; give the name of a folder.")
    try:
        path.mkdir(parents=True, exist_ok=True)
        known = {ASKED, ITEMS}
        others = [entry.name for entry in path.iterdir() if entry.name not in known and entry.name[0] != "."]
    except OSError as error:
        raise InvalidInput(
            f"checkpoint: {path} cannot be used: {error.strerror or error}. Give a folder that is writable."
        ) from error
    if others:
        raise InvalidInput(f"checkpoint: {path} holds {others[0]!r}, so that it is no checkpoint; give a new folder.")
    return path


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Lock a folder for this process; the system unlocks it when the process ends, however it does."""
    in_use = f"{path} is in use by another run; wait for its end, or give another folder."
    with _of_claimed:  # a lock of the system is that of the process, not of a thread
        if path in _claimed:
            raise InvalidInput(in_use)
        _claimed.add(path)
    file = None
    try:
        while file is None:
            try:
                file = (path / LOCKED).open("ab")
                _lock_file(file)
            except (BlockingIOError, PermissionError):
                raise InvalidInput(in_use) from None
            if not (path / LOCKED).exists() or not os.path.samestat(os.fstat(file.fileno()), (path / LOCKED).stat()):
                file.close()  # the run before has just ended, and removed the file
                file = None
        try:
            yield
        finally:
            with contextlib.suppress(OSError):  # of systems that remove no open file
                (path / LOCKED).unlink()
    finally:
        if file is not None:
            file.close()
        with _of_claimed:
            _claimed.discard(path)


def _lock_file(file: IO[bytes]) -> None:
    """Lock a file that is open, or raise an error at once."""
    if os.name == "nt":  # pragma: no cover
        import msvcrt

        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
    else:
        import fcntl

        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # processes that are forked do not have it


def _asked_before(path: Path) -> dict[str, Any] | None:
    """Return what was asked for, and chosen, by the call that has made a folder; None where it is new."""
    file = path / ASKED
    if not file.exists():
        if (path / ITEMS).exists():
            raise InvalidInput(f"checkpoint: {path} has items, but no {ASKED}; give a new folder.")
        return None
    try:
        before: dict[str, Any] = json.loads(file.read_bytes())
        if before.pop("digest") != _digest_of(before):
            raise ValueError("its digest is that of other content")
        _ = before["asked"].keys(), before["chosen"].keys()
    except (OSError, ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
        raise InvalidInput(f"checkpoint: {file} cannot be read ({error}); give a new folder.") from error
    return before


def _digest_of(before: Mapping[str, Any]) -> str:
    return digest(json.dumps(before))


def _write(path: Path, content: bytes) -> None:
    with replacing(path) as temporary, told(str(path), temporary):
        temporary.write_bytes(content)


def _differences(before: Any, now: Any, place: str = "") -> Iterator[str]:
    """Give in words where nested plain data differ."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in [*before, *(key for key in now if key not in before)]:
            inside = f"{place}.{key}" if place else str(key)
            if key not in now or key not in before:
                yield f"{inside} was {'there' if key in before else 'not there'}"
            else:
                yield from _differences(before[key], now[key], inside)
    elif json.dumps(before) != json.dumps(now):  # NaN is itself
        yield f"{place} was {_short(before)} and is {_short(now)}"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:50]}… (digest {digest(value)[:8]})"

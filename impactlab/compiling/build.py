"""From the text of a module to its functions: hash, cache, import."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import sys
import tempfile
import threading
from pathlib import Path
from types import ModuleType

from impactlab.compiling.jit import cache_folder
from impactlab.errors import InvalidInput

_LOCK = threading.Lock()
_modules: dict[str, ModuleType] = {}


def digest(text: str) -> str:
    """Return the digest that names a generated module."""
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def build(text: str) -> ModuleType:
    """Return the module with a text that `generate` returned, compiled at most once for each machine.

    It has the function ``forces`` and, where the network has them, ``forcing``, ``modulation``, ``intensity``,
    ``accept`` and ``peaks``. The file is written whole or not at all, so that several processes may build the same
    network at once. The folder's name holds the versions of the kernels, numba and Python; the file's name holds the
    digest of the text.
    """
    name = f"network_{digest(text)}"
    with _LOCK:
        if name not in _modules:
            file = cache_folder() / f"{name}.py"
            if not file.is_file() or file.read_bytes() != text.encode():
                _write(file, text)
            _modules[name] = _load(name, file, text)
        return _modules[name]


def _write(file: Path, text: str) -> None:
    handle, temporary = tempfile.mkstemp(dir=file.parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "w", encoding="utf-8", newline="\n") as stream:
            stream.write(text)
        os.replace(temporary, file)
    finally:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)


def _load(name: str, file: Path, text: str) -> ModuleType:
    """Return the module of a text that lies in a file. Bytecode is not kept: nobody would notice that it is damaged."""
    module = ModuleType(f"impactlab_{name}")
    module.__file__ = str(file)
    sys.modules[module.__name__] = module  # numba looks the module up when it loads cached code
    try:
        exec(compile(text, str(file), "exec"), vars(module))
    except Exception as error:  # whatever the compiler raises, it is about a kernel
        del sys.modules[module.__name__]
        raise InvalidInput(_explained(str(error), text)) from None
    return module


def _explained(message: str, text: str) -> str:
    """Say which line of whose kernel does not compile, instead of the compiler's own report."""
    reasons = [line.strip() for line in message.splitlines() if line.strip() and not line.startswith("Failed in")]
    numbers = [int(number) for number in re.findall(r"network_\w+\.py\D{1,10}(\d+)", message)]
    lines = text.splitlines()
    if not numbers:
        return f"The generated forces do not compile: {reasons[0]}"
    number = numbers[-1]
    owner = next((line for line in lines[number - 1 :: -1] if line.startswith("def ")), "")
    name = owner.removeprefix("def ").split("(")[0]
    return f"The kernel {name} does not compile at {lines[number - 1].strip()!r}: {reasons[0]}"

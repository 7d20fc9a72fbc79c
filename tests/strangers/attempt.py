"""One call of a reader: what comes of it, in how much time, and what it does besides."""

import contextlib
import io
import os
import sys
import tempfile
import warnings

from time_limit import Hangs, limited

import impactlab as il

SECONDS = 20
"""After so long a call counts as hanging (s)."""

_EVENTS = {
    "os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "socket.connect", "pickle.find_class",
    "ctypes.dlopen",
}  # fmt: skip
"""Events of Python's audit that no reader may cause."""

_TEMPORARY = "/dev/null", tempfile.gettempdir()
"""Where files may be written."""

_watched = {"on": False, "seen": []}


def _hear(event, arguments):
    if not _watched["on"]:
        return
    if event in _EVENTS:
        _watched["seen"].append((event, str(arguments)[:80]))
    elif event == "open" and isinstance(arguments[0], str | bytes):
        mode, flags = arguments[1], arguments[2] or 0
        writes = (isinstance(mode, str) and set(mode) & set("wax+")) or flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        path = os.path.abspath(os.fsdecode(arguments[0]))
        if writes and not path.startswith(_TEMPORARY):
            _watched["seen"].append((event, path))


sys.addaudithook(_hear)


def attempt(call, seconds=SECONDS):
    """Return ("value" | "refused" | "raw" | "hangs", what came of it, side effects)."""
    _watched.update(on=True, seen=[])
    try:
        with (
            limited(seconds),
            warnings.catch_warnings(),
            contextlib.redirect_stderr(io.StringIO()),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            warnings.simplefilter("ignore")
            kind, found = "value", call()
    except il.ImpactLabError as error:
        kind, found = "refused", str(error)
    except Hangs:
        kind, found = "hangs", ""
    except BaseException as error:
        kind, found = "raw", f"{type(error).__name__}: {str(error)[:200]}"
    finally:
        _watched["on"] = False
    return kind, found, list(_watched["seen"])

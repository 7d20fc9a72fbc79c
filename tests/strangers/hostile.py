"""Files that are made to do harm, by kind, and what reads them."""

import json
import os
import pickle
import struct
from collections import Counter
from hashlib import sha256

import impactlab as il
import impactlab.command_line.main as command_line
from impactlab.results.arrays_file import load_arrays
from impactlab.results.checkpoint import checkpoint_in
from impactlab.studies.run_folder import Folder
from tests.strangers.attempt import attempt
from tests.strangers.damage import NETWORK


class Code:
    """Runs a command when it is read from a pickle."""

    def __reduce__(self):
        return os.system, ("touch PWNED",)


def _array(header, data=b""):
    text = header.encode() + b" " * (-(len(header) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + data


def _item(outline, *arrays):
    """An item of a checkpoint with a digest that fits."""
    text = outline if isinstance(outline, bytes) else json.dumps(outline).encode()
    content = len(text).to_bytes(8, "little") + text + b"".join(arrays)
    return sha256(content).digest() + content


_ONE = {"array": 0, "axes": [0], "scalar": False}


def _header(kind="'<f8'", shape="(1,)"):
    return f"{{'descr': {kind}, 'fortran_order': False, 'shape': {shape}, }}"


ITEMS = {
    "pickled array": _item(_ONE, _array(_header("'|O'"), pickle.dumps([Code()]))),
    "pickle": pickle.dumps(Code()),
    "pickle with a digest": sha256(pickle.dumps(Code())).digest() + pickle.dumps(Code()),
    "code in a header": _item(_ONE, _array(_header("__import__('os').system('touch PWNED')"))),
    **{f"shape {shape}": _item(_ONE, _array(_header(shape=shape))) for shape in (
        "(10**12,)", "(1000000000000,)", "(4611686018427387904, 4)", "(-1,)", "('a',)", "()", "5")},
    "unfinished header": _item(_ONE, _array("{'descr': ('<f8', ")),
    "deep header": _item(_ONE, _array("(" * 3000)),
    "large numbers": _item(_ONE, _array(_header("'|S1000000000000'"))),
    **{f"outline {str(outline)[:30]!r}": _item(outline) for outline in (
        _ONE, [_ONE], {"dataset": 5}, {"dataset": [[], []]}, {"dataset": [[[None]], [], {"dict": []}]}, {"dict": [[1]]},
        {"dict": [[{"dict": []}, 1]]}, {"set": [[1]]}, {"array": -1}, {}, 5, b"[" * 100_000, b"1" * 5000, b"{", b"")},
    "length beyond the end": sha256(b"\xff" * 8).digest() + b"\xff" * 8,
    "no axes": _item({"array": 0, "axes": [5], "scalar": False}, _array(_header(), b"\0" * 8)),
}  # fmt: skip

ASKED = {
    f"asked {text[:20]!r}": text for text in (
        "[]", "5", "{", "[" * 100_000, '{"asked":' + "1" * 5000 + "}", '{"asked": {}, "chosen": {}}',
        '{"asked": 5, "chosen": {"seed": "x"}, "digest": "x"}')
}  # fmt: skip

MANIFESTS = {
    f"manifest {text[:20]!r}": text for text in (
        "[]", "null", "{", "[" * 100_000, '{"study": "two-system", "settings": {"out": "PWNED"}, "complete": true}',
        '{"study": "../../x", "settings": [], "complete": false}', '{"study": "os", "settings": {}, "complete": true}')
}  # fmt: skip

_BODY = '[oscillators.a]\ntype = "LinearOscillator"\nstiffness = 1.0\ndamping = 1.0\n'


def _with(options):
    return f"[simulate]\nduration = 1.0\n{options}\n{_BODY}"


NETWORKS = {
    "5000 digits": _BODY.replace("1.0", "1" * 5000), "nested arrays": "x = " + "[" * 5000,
    "nested tables": f"[{'a.' * 5000}b]\nx = 1",
    "nested and whole": _with(f"records = {'[' * 500}{']' * 500}"), "infinite": _BODY.replace("1.0", "1e999"),
    "no character": "a\0b", "no UTF-8": b"[oscillators.\xe9]", "no table": "oscillators = 5",
    "list": "oscillators = [1]",
    "no text at all": b"\0" * 10_000, "date": _BODY.replace("1.0", "1979-05-27"), "dots": "a" + " ." * 20_000,
    "quotes": '"' + '\\"' * 30_000, "10⁴ lines": _BODY + "".join(f"x{number} = 1\n" for number in range(10_000)),
    "type": _BODY.replace("LinearOscillator", "os.system"), "study": 'study = "os"', "pickle": pickle.dumps(Code()),
    **{options: _with(options) for options in (
        'out = "PWNED.nc"', 'executor = "x"', 'initial = "/etc/passwd"', 'checkpoint = "PWNED"', "records = [5]",
        f'records = "Density,bins={"[" * 5000}"', f'records = "Density,bins={"1" * 5000}"', "integrator = [1]",
        "integrator = 5",
        f"seed = {'1' * 4000}", 'progress = "x"', "duration = 1e300", 'import = "os"')},
}  # fmt: skip

_PEER = "PEER\nEQ\nACCELERATION TIME SERIES IN UNITS OF G\nNPTS=   4, DT=   .0100 SEC\n .1 .2 .3 .4\n"

SERIES = {
    **{f"{old} as {new[:9]!r}.AT2": _PEER.replace(old, new) for old, new in (
        ("   4", "4" * 5000), (".0100", "1.2.3"), (".0100", "E"), (".0100", "-"), (".0100", "1E999"), ("   4",
        "9999999999"),
        (".2", "nan"), (".2", "1e999"), (".2", "١"), ("EQ", "\0"), ("EQ", "<script>"), ("\n", "\r"))},
    **{f"{text[:12]!r}.csv": text for text in (
        "\0" * 1000, "1 " * 100_000, "0,1,2\n1,2,3\n", "a,b\n", "0,1\nnan,2\n", "0x10 1\n0x11 2\n", "0,1\n0,2\n",
        "0," + "1" * 5000 + "\n1,2\n", "2020-01-01,1\n2020-01-02,2\n", "x\n" * 10_000 + "0,1\n", "0,1\n1,1e999\n")},
    "result.nc": b"CDF\x01" + b"\xff" * 100, "other.nc": b"\x89HDF\r\n\x1a\n" + b"\0" * 500,
    "pickle.csv": pickle.dumps(Code()),
}  # fmt: skip

PLACES = ("/dev/zero", "/dev/full", "/proc/kmsg", "/proc/self/mem", "a" * 5000, "a\0b", "", ".", "~",
"file:///etc/passwd",
          "http://localhost/x.nc")  # fmt: skip
"""Names of what is no file."""


def hostile(folder):
    """Count what readers make of hostile files; list what is raw, hangs or has side effects."""
    found, missed = Counter(), []

    def read(name, call):
        kind, what, effects = attempt(call)
        found[kind] += 1
        if kind in ("raw", "hangs") or effects:
            missed.append((name, kind, what, effects))

    def written(name, content):
        path = folder / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    for name, content in ITEMS.items():
        path = written("one.item", content)
        read(name, lambda path=path: load_arrays(path))
    kept, run = folder / "kept", folder / "run"
    kept.mkdir()
    run.mkdir()
    for name, content in ASKED.items():
        written("kept/asked.json", content)
        read(name, lambda: checkpoint_in(kept, {"network": NETWORK}, dict).__enter__())
    for name, content in MANIFESTS.items():
        written("run/manifest.json", content)
        read(name, Folder(run).manifest)
        read(name, Folder(run).load_result)
    for name, content in NETWORKS.items():
        path = written("network.toml", content)
        read(name, lambda path=path: il.Network.from_toml(path))
        read(name, lambda path=path: command_line.main(["simulate", str(path), "-q"]))
        read(name, lambda path=path: il.run_study(path))
    for number, (name, content) in enumerate(SERIES.items()):
        path = written(f"{number}.{name.rpartition('.')[2]}", content)
        read(name, lambda path=path: il.read_time_series(path))
    for place in PLACES:
        for call in (il.load, il.read_time_series, il.Network.from_toml, il.rerun, il.network_of, il.citation):
            read(f"{place[:20]!r} in {call.__name__}", lambda call=call, place=place: call(place))
    number = sum(map(len, (ITEMS, ASKED, MANIFESTS, NETWORKS, SERIES, PLACES)))
    return number, found, missed

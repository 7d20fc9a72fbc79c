"""Undocumented names of numba stand in one module."""

import ctypes
import gc
import re
from pathlib import Path

import pytest
from numba import f8

import impactlab
from impactlab.compiling.numba_private import callback, signature_of

PACKAGE = Path(impactlab.__file__).parent

PRIVATE = re.compile(r"\bnumba\.(core|np)\b|\bllvmlite\b|_nrt\b|no_cfunc_wrapper|pipeline_class|\._cache\b")
"""Modules that numba does not document, options of its compiler, and attributes of its dispatchers."""


def test_one_module_knows_undocumented_names():
    found = {
        file.relative_to(PACKAGE).as_posix()
        for file in PACKAGE.rglob("*.py")
        if PRIVATE.search(file.read_text(encoding="utf-8"))
    }
    assert found == {"compiling/numba_private.py"}


def test_compiling_leaves_little_in_the_process(tmp_path):
    """Of each function that is compiled 0.4 MB stayed, in managers of passes that llvmlite never freed."""
    try:
        report = ctypes.CDLL("libc.so.6").mallinfo2
    except (OSError, AttributeError):
        pytest.skip("only the GNU library of C tells how much memory is in use")
    report.restype = type(
        "Mallinfo2", (ctypes.Structure,), {"_fields_": [(f"n{i}", ctypes.c_size_t) for i in range(10)]}
    )

    def used(first):
        """Compile some functions, and return the memory that is in use then (kB)."""
        for number in range(first, first + 4):
            file = tmp_path / f"function_{number}.py"
            file.write_text(f"def function(x):\n    return {number}.5 * x\n", encoding="ascii")
            names = {"__name__": f"function_{number}", "__file__": str(file)}
            exec(compile(file.read_text(encoding="ascii"), file, "exec"), names)
            held.append(callback(names["function"], tmp_path, False, signature_of(f8, f8)))
        gc.collect()
        return report().n7 / 1e3

    held = []
    used(0)  # makes the compiler ready
    before = used(4)
    assert (used(8) - before) / 4 < 120.0

"""Undocumented names of numba stand in one module."""

import re
from pathlib import Path

import impactlab

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

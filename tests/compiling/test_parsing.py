"""Parsing from several threads."""

import pytest

STRESS = """
import argparse, gc, inspect, sys, threading
from impactlab.compiling.kernel_text import parsed

text, failed = inspect.getsource(argparse), []
gc.set_threshold(50, 2, 2)
sys.setswitchinterval(1e-6)

class Garbage:
    def __init__(self):
        self.itself = self
    def __del__(self):
        for _ in range(300):
            pass

def parse():
    for _ in range(10):
        garbage = [Garbage() for _ in range(5)]
        try:
            parsed(text)
        except SystemError as error:
            failed.append(error)

threads = [threading.Thread(target=parse) for _ in range(4)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(len(failed))
"""


@pytest.mark.full
def test_threads_that_parse_at_once_get_their_trees(run_python):
    """In CPython 3.11 `ast.parse` itself fails here."""
    assert run_python("-c", STRESS).strip() == "0"

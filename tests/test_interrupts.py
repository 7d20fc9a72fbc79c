"""Signals that wait, and processes that are forked while something is written."""

import os
import signal
import time

import pytest

from impactlab.compiling import jit, numba_private
from impactlab.interrupts import Uninterrupted, UninterruptedLock

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows sends no signals")


class Terminated(BaseException):
    """What a handler of SIGTERM raises."""


@pytest.fixture
def called(monkeypatch):
    """The signals whose handlers were called; both raise an error."""
    found = []

    def stop(number, frame):
        found.append(number)
        raise Terminated

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    yield found
    for number, handler in before.items():
        signal.signal(number, handler)


def send(*numbers):
    for number in numbers:
        os.kill(os.getpid(), number)
        time.sleep(0.005)  # where Python answers signals


@pytest.mark.parametrize("held", [Uninterrupted(), UninterruptedLock()], ids=lambda item: type(item).__name__)
def test_each_kind_of_signal_is_answered_once(called, held):
    """A scheduler's SIGTERM does not vanish where Ctrl-C came before it."""

    def hold():
        with held:
            with held:
                send(signal.SIGINT, signal.SIGTERM, signal.SIGINT)
            assert called == []

    with pytest.raises(Terminated):
        hold()
    assert called == [signal.SIGINT, signal.SIGTERM]
    with pytest.raises(Terminated):
        send(signal.SIGINT)


def test_machine_code_is_finished_before_an_interrupt_is_answered(called, monkeypatch):
    """What a callback of the compiler raises would be lost, and the code with it."""
    finished = []

    def finalize(library):
        send(signal.SIGINT)
        finished.append(library)

    assert jit.Uninterrupted is Uninterrupted
    monkeypatch.setattr(numba_private, "_finalize", finalize)
    with pytest.raises(Terminated):
        numba_private.JITCodeLibrary._finalize_specific("library")
    assert finished == ["library"]


FORKS = """
import os, signal, sys, threading, time, warnings
import numpy as np, xarray as xr
import impactlab as il
warnings.simplefilter("ignore")
data, folder = xr.Dataset({"a": ("x", np.arange(1000.0))}), sys.argv[1]
stop = threading.Event()

def save():
    while not stop.is_set():
        il.save(data, f"{folder}/parent.nc")

def child(number):
    pid = os.fork()
    if pid == 0:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
        signal.alarm(20)
        il.save(data, f"{folder}/{number}.nc")
        os._exit(0)
    ends.append(os.waitpid(pid, 0)[1])

il.save(data, f"{folder}/parent.nc")  # loads the library
threads, ends = [threading.Thread(target=save) for _ in range(2)], []
[thread.start() for thread in threads]
for number in range(8):
    time.sleep(0.007 * number % 0.03)
    if number % 2:  # forked by another thread than the first
        forking = threading.Thread(target=child, args=(number,))
        forking.start()
        forking.join()
    else:
        child(number)
stop.set()
[thread.join() for thread in threads]
print(ends, threading.active_count(), signal.getsignal(signal.SIGINT) is signal.default_int_handler)
"""


@pytest.mark.full
@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are not forked here")
def test_children_that_are_forked_during_a_save_save(run_python, tmp_path):
    assert run_python("-c", FORKS, tmp_path).split("\n")[0] == f"{[0] * 8} 1 True"

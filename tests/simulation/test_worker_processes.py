"""Processes that replace those that die, and end with the program."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

import impactlab as il
from impactlab.simulation import worker_processes


def slow(number):
    time.sleep(0.4)
    return number, os.getpid()


def prepared(folder):
    with open(os.path.join(folder, str(os.getpid())), "x"):
        pass


def deadly(_):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.full
def test_lost_processes_are_replaced_and_their_work_is_done_again(tmp_path):
    with il.Processes(2, prepared, str(tmp_path)) as processes:
        futures = [processes.submit(slow, number) for number in range(6)]

        def kill():
            while not os.listdir(tmp_path):
                time.sleep(0.02)
            time.sleep(0.6)
            os.kill(int(os.listdir(tmp_path)[0]), signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        found = [future.result() for future in futures]
        killer.join()
        assert [number for number, _ in found] == list(range(6))
        assert len(os.listdir(tmp_path)) > 2
    with pytest.raises(RuntimeError, match="after shutdown"):
        processes.submit(slow, 1)


@pytest.mark.full
def test_work_that_kills_its_process_is_given_up(monkeypatch):
    monkeypatch.setattr(worker_processes, "MOST_LOST", 2)
    with il.Processes(1) as processes, pytest.raises(il.ImpactLabError, match="A process was lost 2 times at the same"):
        processes.submit(deadly, 1).result()


@pytest.mark.full
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_no_process_outlives_the_program(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import os, sys, time\n"
        "import impactlab as il\n"
        "if __name__ == '__main__':\n"
        "    processes = il.Processes(1)\n"
        "    print(processes.submit(os.getpid).result(), flush=True)\n"
        "    processes.submit(time.sleep, 60)\n"
        "    time.sleep(60)\n"
    )
    with subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True) as program:
        worker = int(program.stdout.readline())
        program.kill()
        status = Path(f"/proc/{worker}/stat")
        for _ in range(100):
            if not status.exists() or status.read_text().split()[2] == "Z":
                return
            time.sleep(0.05)
        pytest.fail("The worker lives on.")

"""Signals at random times while programs compile, plan, compute and write: a campaign, with a quick form.

``IMPACTLAB_SIGNALS=200 python -m pytest tests/test_signals.py -m campaign -rP`` sends so many, and prints how long the
answers took.
"""

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter

import bits
import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows sends no signals")

SIGNALS = int(os.environ.get("IMPACTLAB_SIGNALS", "40"))

PROGRAM = """
import os, signal, sys, time, warnings
sys.path.insert(0, {tests!r})
if sys.argv[1] == "compiling":
    os.environ["IMPACTLAB_CACHE"] = sys.argv[2] + "-cache-" + str(os.getpid())
import numpy as np
import impactlab as il
from scenes import base

class Terminated(BaseException):
    pass

stopped = []

def stop(number, frame):
    stopped.append(number)
    if len(stopped) == 1:  # another one might come in the midst of what the program itself does at the end
        raise KeyboardInterrupt if number == signal.SIGINT else Terminated

def compiling():
    il.simulate(base(), 1e6, realizations=520, rng=1)

def planning():
    while True:
        body = il.LinearOscillator(stiffness=9.0, damping=1.0)
        chain = il.chain(2000, body, il.HertzContact(1e4), clearance=0.02, excitation=il.WhiteNoise(1.0))
        il.simulate(chain, 0.02, statistics=["contact_ratio"])

def computing():
    il.simulate(base(), 1e6, realizations=520, rng=1)

def one():
    il.simulate(base(), 1e8, rng=1)

def keeping():
    il.simulate(base(), 1e6, realizations=64, rng=1, checkpoint=sys.argv[2])

def writing():
    result = il.simulate(base(), 2.0, realizations=64, rng=1, record=il.Trajectory(0.01))
    while True:
        il.save(result, sys.argv[2] + ".nc")

def sweeping():
    il.sweep(lambda clearance: base(clearance=clearance), {{"clearance": np.linspace(0.01, 0.1, 2000)}}, duration=100.0,
             realizations=8, rng=1)

def located():
    ball = il.LinearOscillator(stiffness=1.0, damping=0.1)
    network = il.Network({{"a": ball}}, {{"s": il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=0.3)}},
                         {{"a": il.Harmonic(1.0, frequency=2.8)}})
    il.simulate(network, 1e7, integrator=il.EventLocated())

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    try:
        if sys.argv[1] != "compiling":
            il.simulate(base(), 0.1, rng=1)
        print("begun", flush=True)
        globals()[sys.argv[1]]()
    except (KeyboardInterrupt, Terminated) as error:
        print(time.monotonic(), flush=True)
        sys.exit(130 if isinstance(error, KeyboardInterrupt) else 143)
"""

PARTS = "planning", "computing", "one", "keeping", "writing", "sweeping", "located", "compiling"


def answers(folder, number, seed):
    """Send so many signals to programs; return what came of them, and the longest time until an answer (s)."""
    script, drawn, count, times = folder / "program.py", random.Random(seed), Counter(), {}
    script.write_text(PROGRAM.format(tests=os.path.dirname(bits.__file__)), encoding="utf-8")
    for place in range(number):
        part = PARTS[place % len(PARTS)]
        command = [sys.executable, str(script), part, str(folder / "kept")]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        process.stdout.readline()
        time.sleep(drawn.uniform(0.0, 2.0))
        sent = drawn.choice([[signal.SIGINT], [signal.SIGTERM], [signal.SIGINT, signal.SIGTERM]])
        if process.poll() is None:
            begin = time.monotonic()
            for item in sent:
                process.send_signal(item)
            try:
                answered, errors = process.communicate(timeout=30.0)
                answer = float(answered or "nan") - begin
                times[part] = max(times.get(part, 0.0), answer)
                count["late"] += answer > 1.0
                count["raw"] += process.returncode not in (130, 143) or "Traceback" in errors
                if process.returncode not in (130, 143) or "Traceback" in errors:
                    print(part, sent, process.returncode, errors[-1500:])
            except subprocess.TimeoutExpired:
                process.kill()
                count["hangs"] += 1
            count["sent"] += 1
            print(part, dict(count), times, flush=True)
        else:
            count["ended before"] += 1
    return count, {part: round(longest, 2) for part, longest in times.items()}


@pytest.mark.full
def test_signals_are_answered(tmp_path):
    count, times = answers(tmp_path, 4, 1)
    assert count["raw"] == count["hangs"] == 0, times


@pytest.mark.campaign
def test_many_signals_are_answered(tmp_path):
    count, times = answers(tmp_path, SIGNALS, SIGNALS)
    print(dict(count), times, flush=True)
    assert count["raw"] == count["hangs"] == 0

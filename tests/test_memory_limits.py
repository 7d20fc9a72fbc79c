"""The memory that can be had, from files as Linux has them, and under limits of the process."""

import math
import subprocess
import sys

import pytest

from impactlab import memory_limits

GIGABYTE = 1e9


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """A machine of 8 GB of which 4 are free; `write` makes its files."""
    monkeypatch.setattr(memory_limits, "PROC", tmp_path / "proc")
    monkeypatch.setattr(memory_limits, "CONTROL_GROUPS", tmp_path / "cgroup")

    def write(name, text):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="ascii")

    write("proc/meminfo", "MemTotal:        7812500 kB\nMemAvailable:    3906250 kB\n")
    return write


def test_without_limits_it_is_what_the_system_has(machine):
    assert memory_limits.available() == pytest.approx(4.0 * GIGABYTE)


def test_a_group_of_the_second_version_limits_what_is_in_it(machine):
    """As in a container with --memory=3g, or a job of a batch system."""
    machine("proc/self/cgroup", "0::/user/job_7\n")
    machine("cgroup/user/job_7/memory.max", "max\n")
    machine("cgroup/user/memory.max", "3000000000\n")
    machine("cgroup/user/memory.current", "1000000000\n")
    machine("cgroup/user/memory.stat", "anon 600000000\ninactive_file 400000000\n")
    assert memory_limits.available() == pytest.approx(2.4 * GIGABYTE)


def test_the_root_is_looked_at_where_a_container_hides_the_name(machine):
    machine("proc/self/cgroup", "0::/\n")
    machine("cgroup/memory.max", "1000000000\n")
    machine("cgroup/memory.current", "250000000\n")
    assert memory_limits.available() == pytest.approx(0.75 * GIGABYTE)


def test_a_group_of_the_first_version_limits_too(machine):
    machine("proc/self/cgroup", "5:cpu,cpuacct:/\n4:memory:/docker/abc\n0::/\n")
    machine("cgroup/memory/docker/abc/memory.limit_in_bytes", "2000000000\n")
    machine("cgroup/memory/docker/abc/memory.usage_in_bytes", "1500000000\n")
    machine("cgroup/memory/memory.limit_in_bytes", "9223372036854771712\n")
    assert memory_limits.available() == pytest.approx(0.5 * GIGABYTE)


def test_a_group_beyond_its_limit_leaves_nothing(machine):
    machine("proc/self/cgroup", "0::/\n")
    machine("cgroup/memory.max", "1000\n")
    machine("cgroup/memory.current", "2000\n")
    assert memory_limits.available() == 0.0


def test_without_files_the_memory_that_is_built_in_counts(machine, tmp_path):
    (tmp_path / "proc" / "meminfo").unlink()
    assert 0.0 < memory_limits.available() <= math.inf


@pytest.mark.campaign
@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not limit addresses, or do not tell their use")
def test_limits_of_the_process_are_seen():
    """A run beyond ``ulimit -v`` is refused in words, and not by an error of an allocation."""
    code = (
        "import resource, impactlab as il\n"
        "chain = lambda bodies: il.chain(bodies, il.LinearOscillator(stiffness=1.0, damping=1.0), il.HertzContact(1e4),"
        " clearance=0.1, excitation=il.WhiteNoise(1.0))\n"
        "run = lambda bodies: il.simulate(chain(bodies), 0.02, rng=1, step=0.002, spin_up=0.0)\n"
        "run(300)\n"
        "used = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize()\n"
        "resource.setrlimit(resource.RLIMIT_AS, (used + 4 * 10**8,) * 2)\n"
        "try: run(100_000)\n"
        "except il.InvalidInput as error: print(error)"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=True).stdout
    assert "would take" in told
    assert "GB are available" in told

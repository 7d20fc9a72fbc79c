"""Where commands compute: the same bits in threads, processes, on dask and by MPI."""

import importlib.util
import os
import shutil
import subprocess
import sys

import bits
import pytest
from scenes import base

import impactlab as il
from impactlab.command_line.main import main
from impactlab.results.dataset import load

OPTIONS = ["--duration", "2", "--realizations", "600", "--seed", "1", "-q"]

RECORD = """import impactlab as il
import numpy as np

class Last(il.Record):
    def exact_interval(self):
        return 0.5

    def keeper(self, run, realizations, ratio):
        return Keep(ratio)

    def label(self, run, results, interval):
        values = np.concatenate([item["last"] for item in results])
        return {"last": (("realization",), values, {"units": "m", "long_name": "last displacement"})}

class Keep(il.Keeper):
    def add(self, snapshots, batch):
        for sample in self.own(snapshots):
            self.last = sample[0].copy()

    def result(self):
        return {"last": self.last}
"""


@pytest.fixture
def network(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "network.toml").write_text(base().to_toml(), encoding="utf-8")
    (tmp_path / "own.py").write_text(RECORD, encoding="utf-8")
    return ["network.toml", *OPTIONS, "--import", "own.py", "--records", "Last"]


def digest(path):
    return bits.digest(load(path))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--processes", "0"], "--processes is a whole number of at least 1, not 0"),
        (["--workers", "0"], "workers must be a whole number of at least 1, not 0"),
        (["--workers", "2", "--mpi"], "not allowed with"),
    ],
)
def test_engines_that_cannot_be(tmp_path, capsys, options, message):
    (tmp_path / "network.toml").write_text(base().to_toml(), encoding="utf-8")
    try:
        code = main(["simulate", str(tmp_path / "network.toml"), *OPTIONS, *options])
    except SystemExit as ended:
        code = ended.code
    assert code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(("package", "option"), [("distributed", ["--dask", "local"]), ("mpi4py", ["--mpi"])])
def test_an_extra_that_is_missing_is_named(tmp_path, capsys, monkeypatch, package, option):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / "network.toml").write_text(base().to_toml(), encoding="utf-8")
    assert main(["simulate", str(tmp_path / "network.toml"), *OPTIONS, *option]) == 2
    assert f'python -m pip install "impactlab[{option[0][2:]}]"' in capsys.readouterr().err


def test_a_command_that_is_interrupted_tells_how_to_go_on(network, capsys, monkeypatch):
    def interrupted(*given, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(il, "simulate", interrupted)
    assert main(["simulate", "network.toml", *OPTIONS, "--checkpoint", "kept"]) == 130
    assert "what is finished is kept in kept; the same command goes on." in capsys.readouterr().err


def run(command, *start):
    environment = {**os.environ, "OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    subprocess.run([*start, sys.executable, "-m", "impactlab", *command], check=True, env=environment)


@pytest.mark.full
@pytest.mark.parametrize(
    "engine",
    [
        pytest.param(["--processes", "2"], id="processes"),
        pytest.param(
            ["--dask", "local"], id="dask",
            marks=pytest.mark.skipif(not importlib.util.find_spec("distributed"), reason="needs distributed"),
        ),
        pytest.param(
            ["--mpi"], id="mpi",
            marks=pytest.mark.skipif(
                not (importlib.util.find_spec("mpi4py") and shutil.which("mpiexec")), reason="needs mpi4py and mpiexec"
            ),
        ),
    ],
)  # fmt: skip
def test_an_engine_has_the_same_bits(network, engine):
    """With a record of the user's own, and a checkpoint, with which the same command goes on."""
    run(["simulate", *network, "-o", "whole.nc"])
    start = ["mpiexec", "--oversubscribe", "-n", "3"] if engine == ["--mpi"] else []
    for _ in range(2):
        run(["simulate", *network, "-o", "found.nc", "--checkpoint", "kept", *engine], *start)
        assert digest("found.nc") == digest("whole.nc")
    assert sorted(os.listdir("kept")) == ["asked.json", "items"]
    assert load("found.nc").last.sizes == {"realization": 600}

"""The wheel: built from the source files alone, installed into a clean environment, used from there."""

import configparser
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = ("pyproject.toml", "README.md", "LICENSE", "impactlab", "plugins")
PIP = (sys.executable, "-m", "pip", "--disable-pip-version-check")
INSTALLED = {"impactlab": ROOT, "impactlab_two_system": ROOT / "plugins"}
"""Packages of the wheel, and where they are."""
SCRIPTS = "Scripts" if os.name == "nt" else "bin"


def run(*command: str | Path, folder: Path, **variables: str) -> str:
    """Run a command away from the checkout, and return what it printed."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")} | variables
    done = subprocess.run(
        list(map(str, command)), cwd=folder, env=environment, capture_output=True, encoding="utf-8", check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in SOURCES:
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
            shutil.copytree(ROOT / name, source / name, ignore=ignored)
        else:
            shutil.copy(ROOT / name, source / name)
    run(*PIP, "wheel", "--no-build-isolation", "--no-deps", "--wheel-dir", folder, source, folder=folder)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path) -> Path:
    """The scripts of an environment that holds the wheel, and sees the dependencies of this one."""
    environment = wheel.parent / "environment"
    run(sys.executable, "-m", "venv", "--without-pip", environment, folder=wheel.parent)
    scripts = environment / SCRIPTS
    run(*PIP, "--python", scripts / "python", "install", "--no-deps", "--no-index", wheel, folder=wheel.parent)
    # a path in a .pth file comes last, and the .pth files in it (of an editable impactlab) are not read
    where = "import sysconfig; print(sysconfig.get_path('purelib'))"
    own = Path(run(scripts / "python", "-c", where, folder=scripts).strip())
    dependencies = sorted({sysconfig.get_path("purelib"), sysconfig.get_path("platlib")})
    (own / "dependencies.pth").write_text("\n".join(dependencies) + "\n", encoding="utf-8")
    return scripts


@pytest.mark.full
def test_wheel_holds_the_packages_and_nothing_else(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    top = {name.partition("/")[0] for name in names}
    assert {name for name in top if not name.endswith(".dist-info")} == {*INSTALLED}
    assert {"impactlab/py.typed", "impactlab/__init__.pyi"} <= names
    modules = {
        file.relative_to(folder).as_posix()
        for package, folder in INSTALLED.items()
        for file in (folder / package).rglob("*.py")
    }
    assert {name for name in names if name.endswith(".py")} == modules
    assert any(name.endswith("/LICENSE") for name in names)


@pytest.mark.full
def test_the_wheel_brings_the_study_of_the_paper_alone(wheel: Path) -> None:
    """Read from the wheel: ``list`` also finds the distributions of the environment that lends its dependencies."""
    entries = configparser.ConfigParser()
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/entry_points.txt"))
        entries.read_string(archive.read(name).decode("utf-8"))
    assert list(entries["impactlab.studies"]) == ["two-system"]


@pytest.mark.full
def test_installed_command_lists_the_study(installed: Path) -> None:
    listed = run(installed / "impactlab", "list", folder=installed)
    assert "two-system" in {line.split()[0] for line in listed.splitlines()}
    assert "clearance" in run(installed / "impactlab", "show", "two-system", folder=installed)


@pytest.mark.full
def test_studies_of_the_numerics_are_a_distribution_of_the_checkout(installed: Path) -> None:
    """Installed as the README installs them; each is named by a configuration file."""
    options = ("--no-build-isolation", "--no-deps", "--no-index", "-e", installed.parent.parent / "source" / "plugins")
    run(*PIP, "--python", installed / "python", "install", *options, folder=installed)
    listed = [line.split()[0] for line in run(installed / "impactlab", "list", folder=installed).splitlines()]
    named = (tomllib.loads(file.read_text(encoding="utf-8"))["study"] for file in (ROOT / "studies").glob("*.toml"))
    assert listed == sorted(named)
    assert "error" in run(installed / "impactlab", "show", "accuracy", folder=installed)


@pytest.mark.campaign
def test_a_new_study_is_installed_and_runs(installed: Path, tmp_path: Path) -> None:
    impactlab = installed / "impactlab"
    run(impactlab, "new", "my-study", folder=tmp_path)
    options = ("--no-build-isolation", "--no-deps", "--no-index", "-e", tmp_path / "my-study")
    run(*PIP, "--python", installed / "python", "install", *options, folder=tmp_path)
    assert re.search(r"^my-study +A body beside a wall", run(impactlab, "list", folder=tmp_path), re.MULTILINE)
    assert "clearances" in run(impactlab, "show", "my-study", folder=tmp_path)
    assert "holds" in run(impactlab, "run", "my-study", "--quick", folder=tmp_path)
    assert "2 passed" in run(installed / "python", "-m", "pytest", folder=tmp_path / "my-study")


SIMULATION = """
import impactlab as il

body = il.LinearOscillator(stiffness=1.0, damping=1.0)
network = il.Network({"a": body}, {}, {"a": il.WhiteNoise(1.0)})
result = il.simulate(network, 4.0, step=0.05, spin_up=0.0, realizations=2, integrator=il.EulerMaruyama(), rng=1)
"""


@pytest.mark.campaign
@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")  # of two realizations
def test_installed_package_simulates(installed: Path) -> None:
    """The same bits as here, without waiting for a compiler."""
    shown = "print(il.__file__)\nprint(result.mean_square_velocity.item().hex())"
    printed = run(installed / "python", "-c", SIMULATION + shown, folder=installed, NUMBA_DISABLE_JIT="1")
    place, number = printed.splitlines()
    here: dict[str, Any] = {}
    exec(SIMULATION, here)
    assert Path(place).is_relative_to(installed.parent)
    assert number == here["result"].mean_square_velocity.item().hex()


def test_lower_bounds_are_versions_that_go_together() -> None:
    """The first ones that are built against NumPy 2; of Matplotlib the first that knows the root figure."""
    text = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    lower = (item.partition(",")[0].split(">=") for item in text)
    bounds = {name: tuple(map(int, version.split("."))) for name, version in lower}
    oldest = {"numpy": (2, 0), "scipy": (1, 13), "numba": (0, 60), "netCDF4": (1, 7, 2), "matplotlib": (3, 10)}
    oldest["pandas"] = 2, 2, 2
    assert {name: bounds[name] >= version for name, version in oldest.items()} == dict.fromkeys(oldest, True)


def test_citation_has_the_version_of_the_package() -> None:
    version = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert version is not None
    assert version[1] == tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]

"""From text to functions: the cache, several processes, scripts, and Python without compiler."""

import json
import os
import shutil
import threading
from pathlib import Path

import pytest

import impactlab as il
from impactlab.compiling import jit, numba_private
from impactlab.compiling.build import build, digest

SCENE = """
import json
import warnings

import impactlab as il
from impactlab.compiling.jit import cache_folder, compilations

def run(law=il.HertzContact(1e4), integrator=il.RungeKutta4(), bodies=2, realizations=3, **options):
    body = il.DuffingOscillator(30.0, damping=0.4, stiffness=4.0)
    network = il.chain(bodies, body, law, clearance=0.01, excitation=il.WhiteNoise(1.0), walls=True)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.AccuracyWarning)  # too few realizations for standard errors
        data = il.simulate(
            network, 0.4, realizations=realizations, step=0.005, spin_up=0.0, initial="rest", integrator=integrator,
            record=[il.Trajectory(0.1), il.PerRealization()], rng=1, progress=False, **options,
        )
    return [
        [float(value).hex() for value in data[name].values.ravel()]
        for name in ("displacement", "velocity", "contact_force", "mean_contact_force_by_realization")
    ]
"""

RIGHT_HAND_SIDE = """
import json
import impactlab as il
from impactlab.compiling.jit import cache_folder, compilations

network = il.Network({"a": il.DuffingOscillator(1e4, stiffness=4.0)})
slopes = network.compile().rhs(0.0, [0.01, 0.0]).tolist()
print(json.dumps([slopes, compilations(), str(cache_folder())]))
"""


@pytest.fixture(scope="module")
def two_at_once(start_python, tmp_path_factory):
    """A cache that was filled by two processes at once, and what they printed."""
    folder = tmp_path_factory.mktemp("cache") / "not" / "yet" / "there"
    outputs = [start_python("-c", RIGHT_HAND_SIDE, IMPACTLAB_CACHE=str(folder)) for _ in range(2)]
    return folder, [json.loads(output()) for output in outputs]


@pytest.mark.full
def test_two_processes_fill_one_cache(two_at_once):
    folder, ((numbers, compiled, used), (other_numbers, _, other_used)) = two_at_once
    assert numbers == other_numbers
    assert compiled > 0
    assert used == other_used
    assert used.startswith(str(folder))
    assert not list(folder.rglob("*.tmp"))


@pytest.mark.full
def test_a_cache_serves_wherever_it_and_the_package_are(two_at_once, run_python, tmp_path):
    """As in an image, another environment or a new clone, where files are also newer."""
    folder, ((numbers, *_), _) = two_at_once
    shutil.copytree(folder, tmp_path / "cache")
    shutil.copytree(Path(il.__file__).parent, tmp_path / "elsewhere" / "impactlab", copy_function=shutil.copyfile)
    found = run_python(
        "-c", RIGHT_HAND_SIDE, IMPACTLAB_CACHE=str(tmp_path / "cache"), PYTHONPATH=str(tmp_path / "elsewhere")
    )
    again, compiled, _ = json.loads(found)
    assert compiled == 0
    assert again == numbers


@pytest.mark.full
@pytest.mark.skipif(os.name == "nt", reason="Windows has no such rights")
def test_cache_is_private(two_at_once):
    inner = next(two_at_once[0].iterdir())
    assert inner.stat().st_mode & 0o077 == 0


@pytest.fixture(scope="module")
def scene():
    """`SCENE` in this process, whose cache has what it needs from then on."""
    scope = {}
    exec(SCENE, scope)
    scope["run"]()
    return scope


@pytest.mark.full
def test_second_process_and_changed_parameters_compile_nothing(scene, run_python):
    """Laws, bodies and noises with other parameters, more of them, and more realizations.

    What only the compiler needs is not even loaded: numba's library of arrays, and all that it knows of SciPy.
    """
    text = SCENE + (
        "import sys\n"
        "first = run()\nrun(il.HertzContact(2e4), bodies=5, realizations=7)\n"
        "of_compiler = {'numba.np.arrayobj', 'numba.np.arraymath', 'scipy.linalg'} & set(sys.modules)\n"
        "print(json.dumps([first, compilations(), sorted(of_compiler)]))"
    )
    numbers, compiled, of_compiler = json.loads(run_python("-c", text))
    assert compiled == 0
    assert of_compiler == []
    assert numbers == scene["run"]()


SCRIPT = """
import json
import math
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

{scene}
EXPONENT = {exponent}

def power(value):
    return value**EXPONENT

if __name__ == "__main__":
    class PowerLaw(il.ContactLaw):
        stiffness: float = il.parameter(units="N")

        def force(indentation, stiffness):
            return stiffness * power(indentation)

    class WithPotential(PowerLaw):
        def potential(indentation, stiffness):
            return stiffness * power(indentation) * indentation / (EXPONENT + 1)

    results = [run(PowerLaw(1e3)), run(WithPotential(1e3))]
    if EXPONENT == 1:
        results.append(run(il.LinearContact(1e3)))
    else:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
            results.append(run(PowerLaw(1e3), executor=executor))
    print(json.dumps(results))
"""


@pytest.mark.campaign
def test_kernel_in_a_script_that_is_changed(scene, run_python, tmp_path):
    """With and without potential, and in a spawned worker that never sees the class."""
    script = tmp_path / "script.py"
    results = {}
    for exponent in (1, 2):
        script.write_text(SCRIPT.format(scene=SCENE, exponent=exponent), encoding="utf-8")
        results[exponent] = json.loads(run_python(script))
    force, with_potential, linear = results[1]
    assert force == with_potential == linear
    changed, with_potential, in_worker = results[2]
    assert changed == with_potential == in_worker
    assert changed != force


@pytest.mark.full
def test_cache_that_cannot_be_written(run_python, tmp_path):
    """A temporary folder serves the process, and goes with it."""
    file = tmp_path / "file"
    file.touch()
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    places = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary))
    slopes, _, used = json.loads(run_python("-c", RIGHT_HAND_SIDE, IMPACTLAB_CACHE=str(file / "cache"), **places))
    assert slopes == pytest.approx([0.0, -0.05])
    assert used.startswith(str(temporary))
    assert not list(temporary.glob("impactlab-*"))


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="this system knows no owners of files")
@pytest.mark.parametrize("how", ["link", "others", "group", "owner"])
def test_cache_into_which_others_can_write(how, tmp_path, monkeypatch):
    """What is in it is executed."""
    monkeypatch.setenv("IMPACTLAB_CACHE", str(tmp_path / "cache"))
    jit.cache_folder.cache_clear()
    try:
        usual = jit.cache_folder()
        assert usual.parent == tmp_path / "cache"
        if how == "link":
            usual.rename(tmp_path / "elsewhere")
            usual.symlink_to(tmp_path / "elsewhere")
        elif how == "owner":
            mine = os.getuid()
            monkeypatch.setattr(os, "getuid", lambda: mine + 1)
        else:
            usual.chmod(0o702 if how == "others" else 0o720)
        jit.cache_folder.cache_clear()
        with pytest.warns(il.ImpactLabWarning, match=r"is a link, belongs to somebody else or can be written to by ot"):
            used = jit.cache_folder()
        assert tmp_path not in used.parents
        assert used.stat().st_mode & 0o077 == 0
    finally:
        jit.cache_folder.cache_clear()


def test_a_setting_of_numba_survives_threads(tmp_path):
    """It is saved and restored while a function is made."""
    before = numba_private.config.CACHE_DIR
    inside, leave, also_inside, left = (threading.Event() for _ in range(4))

    def one():
        with numba_private._placed_in(tmp_path):
            inside.set()
            leave.wait(60.0)
        left.set()

    def other():
        with numba_private._placed_in(tmp_path):
            also_inside.set()
            left.wait(60.0)

    threads = [threading.Thread(target=one), threading.Thread(target=other)]
    threads[0].start()
    assert inside.wait(60.0)
    threads[1].start()
    assert not also_inside.wait(0.2)
    leave.set()
    for thread in threads:
        thread.join(60.0)
    assert before == numba_private.config.CACHE_DIR


@pytest.mark.full
def test_python_without_compiler_gives_the_same_bits(run_python):
    text = SCENE + "integrators = [il.ExactFlow(measured=False), il.RungeKutta4()]\n"
    text += "result = [run(integrator=i) for i in integrators]"
    scope = {}
    exec(text, scope)
    plain = run_python("-c", text + "\nprint(json.dumps([result, compilations()]))", NUMBA_DISABLE_JIT="1")
    assert json.loads(plain) == [scope["result"], 0]


# Files of modules, without any compilation


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """An empty one in the place of the cache; a text is built once in a process, so that each test has its own."""
    monkeypatch.setattr("impactlab.compiling.build.cache_folder", lambda: tmp_path)
    return tmp_path


def test_module_is_a_file_that_is_named_after_its_text(folder):
    text = '"""δ"""\nvalue = 3\n'
    module = build(text)
    assert module.value == 3
    assert [file.name for file in folder.glob("*.py")] == [f"network_{digest(text)}.py"]
    assert (folder / f"network_{digest(text)}.py").read_bytes() == text.encode()
    assert not list(folder.glob("*.tmp"))
    assert build(text) is module
    assert build("value = 4\n").value == 4


def test_file_that_was_damaged_is_written_again(folder):
    text = "value = 5\n"
    (folder / f"network_{digest(text)}.py").write_text("value = ", encoding="utf-8")
    assert build(text).value == 5


def test_interrupted_write_leaves_nothing(folder, monkeypatch):
    def fail(*_):
        raise OSError("the disk is full")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="the disk is full"):
        build("value = 6\n")
    assert not list(folder.iterdir())


def test_count_of_compilations_sees_a_compilation(tmp_path, monkeypatch):
    """What the tests above count with."""
    monkeypatch.setattr(jit, "cache_folder", lambda: tmp_path)
    before = jit.compilations()
    double = jit.kernel(lambda x: 2.0 * x)
    assert jit.compilations() == before
    assert double(1.0) == 2.0
    assert double(2.0) == 4.0
    assert jit.compilations() == before + 1


def test_changed_parameters_compile_nothing_here(base_case):
    """Parameters, clearances and counts are data; a new law is code."""
    network = base_case()
    il.simulate(network, 1.0, realizations=64, step=0.004, spin_up=0.0, rng=1)
    before = jit.compilations()
    changed = base_case(frequency_ratio=8.0, clearance=-0.01)
    changed = changed.replace(contacts={"stop": il.Contact("two", il.WALL, il.HertzContact(2e5), clearance=0.3)})
    il.simulate(changed, 1.0, realizations=70, spin_up=0.1, rng=2)
    assert jit.compilations() == before

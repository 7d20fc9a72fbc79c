"""Studies: settings, runs, folders, what is kept of a run that stops."""

from __future__ import annotations

import functools
import hashlib
import json
import os
import re
import sys
import threading
import tomllib
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import impactlab as il
from impactlab.errors import warn
from impactlab.studies import Item, Study, SweepItem
from impactlab.studies.discovery import make_study, parse_setting, plugins, study_class, toml
from impactlab.studies.simulations import simulations
from impactlab.studies.study import judged

PLUGIN = Path(__file__).parents[1] / "plugin_example"
CONFIGURATIONS = sorted((Path(__file__).parents[2] / "studies").glob("*.toml"))
SHORT = {"duration": 20.0}


@pytest.fixture(autouse=True)
def _stranger(monkeypatch):
    monkeypatch.syspath_prepend(str(PLUGIN))


@pytest.fixture
def example():
    return study_class("example")


@pytest.fixture
def simulated(monkeypatch):
    """The clearances that are simulated, in order; `stop_at` raises there."""
    simulate, done = il.simulate, []

    @functools.wraps(simulate)  # a sweep reads its options
    def spy(network, **options):
        clearance = network.contacts["stop"].clearance
        if spy.stop_at == clearance:
            raise spy.stop_with
        done.append(clearance)
        return simulate(network, **options)

    spy.stop_at, spy.stop_with, spy.done = None, KeyboardInterrupt(), done
    monkeypatch.setattr(il, "simulate", spy)
    return spy


def numbers(tree: xr.DataTree) -> xr.Dataset:
    return tree["statistics"].to_dataset(inherit=False).drop_attrs()


# settings


@pytest.mark.parametrize("path", CONFIGURATIONS, ids=lambda path: path.name)
def test_configuration_files_hold_the_defaults(path):
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    study = study_class(data.pop("study"))()
    assert data == study.settings()


def test_there_are_configuration_files():
    assert CONFIGURATIONS


def test_toml_of_a_study_makes_it_again(example, tmp_path):
    study = example(clearances=[0.25, 3], law="linear", reference=False, largest_ratio=1e-9)
    path = tmp_path / "study.toml"
    path.write_text(toml(study), encoding="utf-8")
    assert make_study(path) == study
    assert make_study(str(path)) == study


def test_settings_override_the_file_and_the_quick_form(example, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text('study = "example"\nrealizations = 7\n', encoding="utf-8")
    made = make_study(path, {"clearances": [3.0, 4.0]}, quick=True)
    assert made == example(realizations=7, clearances=(3.0, 4.0))
    assert make_study(example, quick=True).clearances == (0.5,)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"clearence": [0.1]}, "clearance"),
        ({"clearances": 0.1}, r"must be a list of numbers, not 0.1"),
        ({"clearances": ["wide"]}, r"clearances must be real numbers"),
        ({"clearances": [float("nan")]}, "finite"),
        ({"clearances": [-1.0]}, "at least 0 m"),
        ({"realizations": 1.5}, "whole number, not 1.5"),
        ({"reference": 1}, "true or false"),
        ({"law": 3}, "must be a string"),
    ],
)
def test_bad_settings(settings, message):
    with pytest.raises(il.InvalidInput, match=message):
        il.run_study("example", settings=settings)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('study = "exampel"', "did you mean 'example'"),
        ("realizations = 3", "must name its study"),
        ("study = [", "cannot be read as TOML"),
        ('study = "example"\nrealisations = 3', "study.toml: .*did you mean 'realizations'"),
    ],
)
def test_bad_configuration_files(text, message, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(il.InvalidInput, match=message):
        il.run_study(path)


def test_what_is_not_a_study(tmp_path):
    with pytest.raises(il.InvalidInput, match="There is no file"):
        il.run_study(tmp_path / "missing.toml")
    with pytest.raises(il.InvalidInput, match="There is no study 'nothing'"):
        il.run_study("nothing")
    with pytest.raises(il.InvalidInput, match=r"study must be a path, an il.Study or a class"):
        il.run_study(3)
    with pytest.raises(il.InvalidInput, match="workers"):
        il.run_study("example", workers=0)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("clearances=[0.05]", ("clearances", [0.05])),
        ("law=linear", ("law", "linear")),
        ('law = "a b"', ("law", "a b")),
        ("law=16", ("law", "16")),
        ("reference=false", ("reference", False)),
    ],
)
def test_settings_of_the_command_line(example, text, value):
    assert parse_setting(text, example()) == value


@pytest.mark.parametrize("text", ["clearances", "clearences=[1.0]", "realizations=many", "duration="])
def test_bad_settings_of_the_command_line(example, text):
    with pytest.raises(il.InvalidInput):
        parse_setting(text, example())


# plugins


def test_a_stranger_is_found_like_the_bundled_one():
    found = {plugin.name: plugin for plugin in plugins()}
    assert found["example"].distribution == "impactlab-example 1.0"
    assert found["example"].problem == ""


def test_a_broken_plugin_is_reported_and_hides_no_other(tmp_path, monkeypatch):
    folder = tmp_path / "broken-2.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: broken\nVersion: 2.0\n")
    entries = ["absent = nowhere_at_all:Thing", "misnamed = impactlab_example:ExampleStudy", "wrong = math:pi"]
    (folder / "entry_points.txt").write_text("\n".join(["[impactlab.studies]", *entries]))
    monkeypatch.syspath_prepend(str(tmp_path))
    found = {plugin.name: plugin for plugin in plugins()}
    assert found["example"].study is not None
    assert "ModuleNotFoundError" in found["absent"].problem
    assert "named 'example'" in found["misnamed"].problem
    assert "not a subclass" in found["wrong"].problem
    with pytest.raises(il.InvalidInput, match=r"'absent' of broken 2\.0 cannot be used: ModuleNotFoundError"):
        il.run_study("absent")


# items


def test_two_items_with_one_key_are_refused(example):
    with pytest.raises(il.InvalidInput, match="two items with the key"):
        il.run_study(example(clearances=(1.0, 1.0)))


def test_options_must_be_data(monkeypatch, example):
    network = il.Network({"body": il.LinearOscillator()})
    items = [Item("one", network, {"duration": 1.0, "rng": np.random.default_rng(1)})]
    monkeypatch.setattr(example, "items", lambda _: items)
    with pytest.raises(il.InvalidInput, match="plain data"):
        simulations(example())


def test_a_study_must_be_complete():
    class Half(Study):
        name = "half"
        title = "Half"

    with pytest.raises(il.InvalidInput, match="does not define items, collect"):
        Half()


# runs


def test_a_run_without_a_folder():
    result = il.run_study("example", settings=SHORT)
    assert result.folder is None
    assert result.passed
    assert list(result.claims["verdict"].values) == ["holds"]
    assert result.tree["statistics"].sizes["clearance"] == 2
    assert json.loads(result.tree.attrs["impactlab_configuration"])["study"]["settings"]["duration"] == 20.0
    assert list(result.figures) == ["system", "contact_ratio"]


def test_numbers_do_not_depend_on_the_workers():
    one, two, default = (il.run_study("example", settings=SHORT, workers=n).tree for n in (1, 2, None))
    xr.testing.assert_identical(numbers(one), numbers(two))
    xr.testing.assert_identical(numbers(one), numbers(default))


@pytest.mark.filterwarnings("ignore::impactlab.AccuracyWarning")
@pytest.mark.parametrize("kind", ["item", "sweep"])
def test_a_tolerance_that_is_missed_is_a_check_that_failed(kind):
    network = il.Network({"a": il.LinearOscillator(damping=1.0, stiffness=1.0)}, {}, {"a": il.WhiteNoise(1.0)})
    options = {"tolerance": {"mean_velocity": 1e-9}, "max_seconds": 0.1, "rng": 1}

    class Accurate(Study):
        name = "accurate"
        title = "An accuracy that is not reached"

        def items(self):
            swept = SweepItem("one", lambda mass: network, {"mass": [1.0]}, options)
            return [Item("one", network, options) if kind == "item" else swept]

        def collect(self, results):
            return xr.DataTree.from_dict({"/one": results.pop("one")})

    result = il.run_study(Accurate())
    assert not result.passed
    assert [check.name for check in result.checks] == ["tolerances"]
    assert re.fullmatch(r"Not reached in the time: one \d.* times\.", result.checks[0].detail)
    assert [check.ok for check in judged(result.study, result.tree).checks] == [False]


def test_files_of_a_run(tmp_path):
    out = tmp_path / "a" / "out"
    result = il.run_study("example", settings=SHORT, out=out)
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    files = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()} - {"manifest.json"}
    assert files == {"result.nc", "report.html", "figures/system.svg", "figures/contact_ratio.svg"}
    assert {name: hashlib.sha256((out / name).read_bytes()).hexdigest() for name in files} == manifest["files"]
    assert manifest["complete"]
    assert manifest["passed"]
    assert manifest["settings"] == result.study.settings()
    with xr.open_datatree(out / "result.nc", engine="netcdf4") as tree:
        assert tree.attrs["Conventions"].startswith("CF-")
        assert tree["claims/verdict"].values.tolist() == ["holds"]
        np.testing.assert_array_equal(
            tree["statistics/mean_square_displacement"], result.tree["statistics/mean_square_displacement"]
        )


@pytest.mark.full
def test_the_report_needs_no_other_file(tmp_path):
    il.run_study("example", settings={**SHORT, "law": "a & b"}, out=tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert text.count('src="data:image/svg+xml;base64,') == text.count("<img ") == 2
    assert "http" not in text
    assert "A body that a wall stops &lt;example&gt;" in text
    assert "<example>" not in text
    assert "impactlab run example --set duration=20.0 --set &#x27;law=&quot;a &amp; b&quot;&#x27;" in text
    assert 'class="good">holds</td>' in text


def test_the_report_begins_with_claims_and_leads_to_their_figures(tmp_path):
    il.run_study("example", settings=SHORT, out=tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    links = re.findall(r'href="#([^"]*)"', text)
    assert set(links) <= set(re.findall(r' id="([^"]*)"', text))
    titles = re.findall(r"<h2 [^>]*>([^<]*)</h2>", text)
    assert titles == ["Claims", "Figures", "Checks", "Contact ratio", "Settings", "How to run it again"]
    (nav,) = re.findall("<nav>(.*?)</nav>", text)
    assert re.findall(">([^<]*)</a>", nav) == titles
    assert '<a href="#figure-2">figure 2</a>' in text[: text.index("<figure")]
    (last,) = re.findall(r'<figure id="figure-2">.*?</figure>', text)
    assert "<b>Figure 2.</b> the part of the time that the contact is closed, against the clearance" in last
    assert '<span class="good">holds</span> <a href="#claim-1">The contact is closed for less' in last
    assert '<meta name="viewport"' in text
    assert "@media print" in text


@pytest.mark.full
def test_figures_are_the_same_bytes_again(tmp_path):
    one, two = (il.run_study("example", settings=SHORT, out=tmp_path / name).folder for name in "ab")
    for name in ("system", "contact_ratio"):
        picture = (one / "figures" / f"{name}.svg").read_bytes()
        assert picture.startswith(b"<?xml")
        assert picture == (two / "figures" / f"{name}.svg").read_bytes()


def test_captions_of_several_figures():
    class Several(Study):
        name = "several"
        title = "Several"
        captions = {"map_*": "A map.", "map_last": "The last map."}  # noqa: RUF012

    shown = [Several.caption(name) for name in ("map_one", "map_last", "other_one")]
    assert shown == ["A map.", "The last map.", "other one"]


def test_a_run_that_stops_is_continued(tmp_path, simulated):
    whole = il.run_study("example", settings=SHORT)
    simulated.done.clear()
    simulated.stop_at = 1.0
    with pytest.raises(KeyboardInterrupt):
        il.run_study("example", settings=SHORT, out=tmp_path)
    assert [path.name for path in (tmp_path / "items").glob("*.item")] == ["clearance%2F0.5.item"]
    assert not json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))["complete"]
    simulated.stop_at = None
    result = il.run_study("example", settings=SHORT, out=tmp_path)
    assert simulated.done == [0.5, 1.0]  # each once
    xr.testing.assert_identical(numbers(result.tree), numbers(whole.tree))
    assert not (tmp_path / "items").exists()


@pytest.mark.full
@pytest.mark.parametrize("change", ["settings", "damage"])
def test_a_kept_item_is_used_only_if_it_is_the_same_and_whole(tmp_path, simulated, change):
    simulated.stop_at = 1.0
    with pytest.raises(KeyboardInterrupt):
        il.run_study("example", settings=SHORT, out=tmp_path)
    simulated.stop_at = None
    settings = {**SHORT, "law": "linear"} if change == "settings" else SHORT
    if change == "damage":
        (item,) = (tmp_path / "items").glob("*.item")
        item.write_bytes(item.read_bytes()[:1000])
    il.run_study("example", settings=settings, out=tmp_path)
    assert sorted(simulated.done) == [0.5, 0.5, 1.0]


def test_an_error_names_the_item(tmp_path, simulated):
    simulated.stop_at, simulated.stop_with = 1.0, il.Diverged("too wild")
    with pytest.raises(il.Diverged, match="Item 'clearance/1': too wild"):
        il.run_study("example", settings=SHORT, out=tmp_path)


def test_an_error_stops_the_item_that_runs_beside(monkeypatch, example):
    """The second would take hours."""
    (first, second), begun = example(**SHORT).items(), threading.Event()
    endless = second._replace(options={**second.options, "duration": 1e8})
    monkeypatch.setattr(example, "items", lambda _: [first, endless])
    simulate = il.simulate

    def failing(network, **options):
        if options["duration"] == 1e8:
            begun.set()
            return simulate(network, **options)
        assert begun.wait(60.0)  # they run at a time
        raise il.Diverged("too wild")

    monkeypatch.setattr(il, "simulate", failing)
    with pytest.raises(il.Diverged, match=r"Item 'clearance/0\.5': too wild"):
        il.run_study(example(), workers=2)


def test_a_warning_names_the_items_once(monkeypatch):
    simulate = il.simulate

    def warning(network, **options):
        warn("drift", "little is known")
        return simulate(network, **options)

    monkeypatch.setattr(il, "simulate", warning)
    with pytest.warns(il.AccuracyWarning, match=r"In 2 of 2 items, first 'clearance/0\.5': little is known") as caught:
        il.run_study("example", settings=SHORT)
    assert len(caught) == 1


# sweeps


def swept(example, make=None):
    """A study that simulates what the example does as one sweep, beside one item."""

    class SweptStudy(Study):
        name = "swept"
        title = "A sweep"

        def items(self):
            whole = example(**SHORT)
            by_clearance = {item.network.contacts["stop"].clearance: item.network for item in whole.items()}
            values = {"clearance": list(by_clearance)}
            options = {**whole.items()[0].options, "common_random_numbers": True}
            return [
                SweepItem("all", make or (lambda clearance: by_clearance[clearance]), values, options),
                *whole.items(),
            ]

        def collect(self, results):
            return xr.DataTree.from_dict(
                {"/swept": results.pop("all"), "/statistics": example().collect(results).statistics.to_dataset()}
            )

    return SweptStudy()


@pytest.mark.full
def test_a_sweep_of_a_study_is_one_result(example, tmp_path, simulated):
    tree = il.run_study(swept(example)).tree
    for name in tree["statistics"].data_vars:
        np.testing.assert_array_equal(tree["swept"][name], tree["statistics"][name])
    simulated.stop_at = 1.0
    with pytest.raises(KeyboardInterrupt):
        il.run_study(swept(example), out=tmp_path)
    assert [path.name for path in (tmp_path / "items").glob("*.item")] == ["all, clearance=0.5.item"]
    simulated.stop_at = None
    simulated.done.clear()
    continued = il.run_study(swept(example), out=tmp_path).tree
    assert sorted(simulated.done) == [0.5, 1.0, 1.0]  # the first point of the sweep was kept
    xr.testing.assert_identical(continued["swept"].to_dataset().drop_attrs(), tree["swept"].to_dataset().drop_attrs())


def test_a_study_is_refused_with_a_point_of_its_sweep(example, simulated):
    def refuse(clearance):
        raise il.InvalidInput("too close")

    with pytest.raises(il.InvalidInput, match=r"Item 'all, clearance=0\.5': too close"):
        il.run_study(swept(example, refuse))
    assert simulated.done == []


# folders


def test_a_folder_that_cannot_be_used_is_refused_before_anything_runs(tmp_path, simulated):
    file = tmp_path / "file"
    file.write_text("kept")
    with pytest.raises(il.InvalidInput, match="is a file"):
        il.run_study("example", out=file)
    with pytest.raises(il.InvalidInput, match="Cannot use"):
        il.run_study("example", out=file / "inside")
    with pytest.raises(il.InvalidInput, match="not the folder of a study's run"):
        il.run_study("example", out=tmp_path)
    assert simulated.done == []
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_folder_that_is_not_writable(tmp_path, simulated):
    tmp_path.chmod(0o500)
    if os.access(tmp_path, os.W_OK):
        pytest.skip("this user may write everywhere")
    with pytest.raises(il.InvalidInput, match="writable"):
        il.run_study("example", out=tmp_path)
    assert simulated.done == []


def test_a_folder_in_which_no_file_can_be_made(tmp_path, simulated, monkeypatch):
    def refuse(**_):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("impactlab.results.dataset.tempfile.mkstemp", refuse)
    with pytest.raises(il.InvalidInput, match="Permission denied"):
        il.run_study("example", out=tmp_path)
    assert simulated.done == []


@pytest.mark.full
def test_a_folder_of_another_study_is_refused_and_one_of_the_same_replaced(tmp_path):
    il.run_study("example", settings=SHORT, out=tmp_path)
    for old in ("old.svg", "old.png"):
        (tmp_path / "figures" / old).write_bytes(b"of an earlier version")
    il.run_study("example", settings={**SHORT, "clearances": [2.0]}, out=tmp_path)
    assert not list((tmp_path / "figures").glob("old.*"))
    manifest = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["settings"]["clearances"] == [2.0]
    manifest["study"] = "other"
    (tmp_path / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    with pytest.raises(il.InvalidInput, match=r"manifest.json is damaged, or was changed"):
        il.run_study("example", settings=SHORT, out=tmp_path)
    del manifest["digest"]
    (tmp_path / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    with pytest.raises(il.InvalidInput, match="a run of the study 'other'"):
        il.run_study("example", settings=SHORT, out=tmp_path)


def test_modules_of_studies_are_light():
    """Studies are listed without what only a run needs."""
    import subprocess

    code = (
        "import sys; from impactlab.studies.discovery import plugins; plugins();"
        "print([name for name in ('numba', 'xarray', 'matplotlib') if name in sys.modules])"
    )
    path = os.pathsep.join([str(PLUGIN), *sys.path])
    shown = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=True
    )
    assert shown.stdout.strip() == "[]"

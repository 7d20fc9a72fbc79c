"""Files of every kind that impactlab writes, with a bit turned round or the end cut off."""

from collections import Counter

import numpy as np
import xarray as xr

import impactlab as il
from impactlab.results.arrays_file import load_arrays, save_arrays
from impactlab.results.checkpoint import checkpoint_in
from impactlab.studies.run_folder import Folder
from tests.strangers.attempt import attempt

BODY = il.LinearOscillator(stiffness=10.0, damping=1.0)
NETWORK = il.Network(
    {"a": BODY, "b": il.LinearOscillator(stiffness=5.0, damping=1.0)},
    {"g": il.Contact("a", "b", il.HertzContact(1e3), clearance=0.1)},
    {"a": il.WhiteNoise(1.0), "b": il.WhiteNoise(1.0)},
)


def content(data):
    """What a dataset or tree holds, exactly, to be compared."""
    groups = (
        [("/", data)] if isinstance(data, xr.Dataset) else [(n.path, n.to_dataset(inherit=False)) for n in data.subtree]
    )
    found = {}
    for path, group in groups:
        found |= {(path, f":{key}"): repr(value) for key, value in group.attrs.items()}
        for name, item in group.variables.items():
            values = repr(item.values.tolist()) if item.dtype.kind == "O" else item.values.tobytes()
            found[path, name] = item.dims, values, repr(sorted((key, repr(value)) for key, value in item.attrs.items()))
    return found


def results():
    """A result, a sweep and a tree, as they are made."""
    record = [il.Density(bins=50), il.PerRealization()]
    one = il.simulate(NETWORK, 20.0, realizations=64, rng=1, record=record)

    def at(clearance):
        return NETWORK.replace(contacts={"g": il.Contact("a", "b", il.HertzContact(1e3), clearance=clearance)})

    many = il.sweep(at, {"clearance": [0.1, 0.2]}, duration=5.0, realizations=64, rng=1)
    return one, many, xr.DataTree.from_dict({"/": xr.Dataset(attrs=one.attrs), "/statistics": one, "/points": many})


def kinds(folder):
    """Give the name of each kind of file, its path and what reads it."""
    one, many, tree = results()
    for name, data in (("result", one), ("sweep", many), ("tree", tree)):
        path = folder / f"{name}.nc"
        il.save(data, path)
        yield f"netCDF 4, {name}", path, lambda path=path: content(il.load(path))
    classic = folder / "classic.nc"
    xr.open_dataset(folder / "result.nc").to_netcdf(classic, format="NETCDF3_64BIT", engine="netcdf4")
    yield "netCDF 3, result", classic, lambda: content(il.load(classic))
    item = folder / "one.item"
    save_arrays(("name", one), item)
    yield "item of a checkpoint", item, lambda: content(load_arrays(item)[1])
    kept = folder / "kept"
    with checkpoint_in(kept, {"network": NETWORK}, lambda: {"seed": [1, 2]}):
        pass

    def chosen():
        with checkpoint_in(kept, {"network": NETWORK}, lambda: {"seed": [3, 4]}) as checkpoint:
            return checkpoint.chosen

    yield "what a checkpoint was asked", kept / "asked.json", chosen
    run = Folder(folder / "run")
    (folder / "run").mkdir()
    run.write_manifest(_Study(), complete=True, files={"result.nc": "0" * 64})
    yield "manifest of a study", folder / "run" / "manifest.json", run.manifest


class _Study:
    name, title = "example", "An example"

    def settings(self):
        return {"clearances": [0.01, 0.05], "duration": 100.0, "realizations": 512}


def damaged(path, read, flips, cuts, seed):
    """Count what comes of flips of single bits and of files whose end is cut off; name those that are not noticed."""
    generator, whole, found, missed = np.random.default_rng(seed), path.read_bytes(), Counter(), []
    kind, good, _ = attempt(read)
    assert kind == "value", good
    for number in range(flips + cuts):
        if number < flips:
            place, bit = int(generator.integers(len(whole))), int(generator.integers(8))
            path.write_bytes(whole[:place] + bytes([whole[place] ^ (1 << bit)]) + whole[place + 1 :])
            where = "flip", place, bit
        else:
            where = "cut", int(generator.integers(len(whole)))
            path.write_bytes(whole[: where[1]])
        kind, read_now, effects = attempt(read)
        if kind == "value":  # what is added is harmless: a digest whose name is damaged
            kind = "harmless" if {key: read_now.get(key) for key in good} == good else "silent"
        found[where[0], kind] += 1
        if kind not in ("harmless", "refused") or effects:
            missed.append((*where, kind, read_now if kind == "raw" else effects))
    path.write_bytes(whole)
    return found, missed

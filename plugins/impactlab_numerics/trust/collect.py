"""Judged networks as a tree, and back; they are kept line by line if a file is named."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from impactlab.errors import InvalidInput
from impactlab_numerics.trust.judge import judge

if TYPE_CHECKING:
    from impactlab_numerics.trust.study import TrustStudy

_TEXTS = {"class": "class of the network", "outcome": "what became of the run", "kind": "kind of the reference"}
_NUMBERS = {
    "bodies": ("1", "number of bodies"),
    "contacts": ("1", "number of contacts"),
    "step": ("s", "automatic step"),
    "reference_step": ("s", "step of the reference"),
    "seconds": ("s", "time of the run"),
    "reference_seconds": ("s", "time of the reference"),
}
_ROWS = {
    "relative": "difference over the size of the reference",
    "relative_error": "standard error of the difference over that size",
    "excess": "difference over what is allowed: 0.5 % and three standard errors",
    "z": "difference in standard errors",
    "held": "whether the interval of 95 % holds what is right; NaN where there is none",
    "chance": "whether the difference is one of chance, as further runs show",
    "scarce": "whether few data can explain the difference",
}


def collect(study: TrustStudy, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
    """Judge all networks and return them, ``networks`` and ``comparisons``."""
    path = Path(study.kept_in) if study.kept_in else None
    kept = {} if path is None else _load(path, study)
    found = []
    for seed in study.seeds:
        if seed not in kept:
            kept[seed] = judge(seed, share=study.share, body_steps=study.reference_body_steps)
            if path is not None:
                with path.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(_settings(study) | kept[seed]) + "\n")
        found.append(kept[seed])
    return tree_of(found)


def _settings(study: TrustStudy) -> dict[str, float]:
    return {"share": study.share, "reference_body_steps": study.reference_body_steps}


def _load(path: Path, study: TrustStudy) -> dict[int, dict[str, Any]]:
    """Return the judged networks of a file by seed; an incomplete last line is left out."""
    if not path.is_file():
        return {}
    found = {}
    *lines, last = path.read_text(encoding="utf-8").split("\n")
    if last:
        path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
    try:
        for item in map(json.loads, lines):
            if _settings(study).items() <= item.items():
                found[int(item["seed"])] = item
    except (ValueError, LookupError, AttributeError) as error:
        raise InvalidInput(f"{path} does not hold networks that were judged; name another file in kept_in.") from error
    return found


def tree_of(found: Sequence[Mapping[str, Any]]) -> xr.DataTree:
    """Return judged networks as a tree."""
    texts = {name: [str(item.get(name, "")) for item in found] for name in _TEXTS}
    networks = xr.Dataset(
        {
            **{name: ("network", values, {"long_name": _TEXTS[name]}) for name, values in texts.items()},
            **{
                name: ("network", [float(item.get(name, np.nan)) for item in found],
                       {"units": units, "long_name": long_name})
                for name, (units, long_name) in _NUMBERS.items()
            },
            "messages": ("network", ["\n".join(item["messages"]) for item in found], {"long_name": "what was said"}),
        },
        {"network": [item["seed"] for item in found]},
    )  # fmt: skip
    rows = [(item["seed"], row) for item in found for row in item["rows"]]
    comparisons = xr.Dataset(
        {
            name: ("comparison", np.array([_number(row[name]) for _, row in rows], dtype=float), {"long_name": text})
            for name, text in _ROWS.items()
        },
        {
            "network": ("comparison", np.array([seed for seed, _ in rows], dtype=int)),
            "statistic": ("comparison", np.array([row["statistic"] for _, row in rows], dtype=str)),
            "label": ("comparison", np.array([row["label"] for _, row in rows], dtype=str)),
        },
    )
    return xr.DataTree.from_dict({"/networks": networks, "/comparisons": comparisons})


def _number(value: Any) -> float:
    return np.nan if value is None else float(value)


def found_of(tree: xr.DataTree) -> list[dict[str, Any]]:
    """Return the judged networks of a tree, as `impactlab_numerics.trust.judge.judge` returned them."""
    networks, comparisons = (tree[name].to_dataset() for name in ("networks", "comparisons"))
    found: dict[int, dict[str, Any]] = {}
    for index, seed in enumerate(networks["network"].values.tolist()):
        item = {name: networks[name].values[index].item() for name in (*_NUMBERS,)}
        item |= {name: str(networks[name].values[index]) for name in _TEXTS}
        said = str(networks["messages"].values[index])
        found[seed] = {"seed": seed, **item, "messages": said.split("\n") if said else [], "rows": []}
    columns = {name: comparisons[name].values.tolist() for name in (*_ROWS, "network", "statistic", "label")}
    for values in zip(*columns.values(), strict=True):
        row = dict(zip(columns, values, strict=True))
        row["held"] = None if np.isnan(row["held"]) else bool(row["held"])
        row |= {name: bool(row[name]) for name in ("chance", "scarce")}
        found[row.pop("network")]["rows"].append(row)
    return list(found.values())

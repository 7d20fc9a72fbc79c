"""Commands on networks in files: simulate one, and draw what was found."""

from __future__ import annotations

import argparse
import contextlib
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import impactlab
from impactlab.command_line.engines import add_engines, engine, import_all
from impactlab.command_line.output import DONE, FAILED, Command, in_columns, say
from impactlab.errors import InvalidInput

if TYPE_CHECKING:
    import xarray as xr

_GIVEN_HERE = {"network", "rng", "record", "executor", "progress", "out", "checkpoint"}
"""Parameters of `simulate` that are no options of a file; for two of them there are others."""


def add_commands(command: Command) -> None:
    """Add the commands of this family."""
    simulate = command("simulate", _simulate, "simulate a network that a TOML file describes")
    simulate.add_argument("network", metavar="NETWORK.toml", help="what il.Network.to_toml writes")
    simulate.add_argument("--duration", type=float, metavar="SECONDS", help="time that is measured")
    simulate.add_argument("--realizations", type=int, metavar="N", help="number of realizations (default: 1)")
    simulate.add_argument("--seed", type=int, metavar="N", help="of the random numbers (default: another each time)")
    simulate.add_argument("--records", nargs="+", metavar="RECORD", help="such as Density,quantity=velocity Trajectory")
    simulate.add_argument("-o", "--out", metavar="RESULT.nc", help="file for the result")
    simulate.add_argument("--checkpoint", metavar="FOLDER", help="keep what is finished: the same command goes on")
    add_engines(simulate)
    simulate.add_argument("--import", dest="modules", action="append", default=[], metavar="MODULE",
                          help="module, or .py file, with classes of your own; it is executed")  # fmt: skip
    simulate.add_argument("-q", "--quiet", action="store_true", help="print no statistics and no progress")
    plot = command("plot", _plot, "draw what a result holds, or a network that a TOML file describes")
    plot.add_argument("file", metavar="RESULT.nc", help="file of a simulation or a sweep; or NETWORK.toml")
    plot.add_argument("-o", "--out", metavar="FIGURE.svg", help="file for the figure (default: RESULT.svg)")


def _plot(options: argparse.Namespace) -> int:
    import xarray as xr

    from impactlab.networks.network_file import NetworkFile
    from impactlab.plotting.drawing import draw_network
    from impactlab.plotting.overview import overview
    from impactlab.plotting.style import save_figure
    from impactlab.results.dataset import load

    file = Path(options.file)
    if not file.name:
        raise InvalidInput(f"{options.file!r} is no file.")
    out = options.out or str(file.with_suffix(".svg"))
    if file.suffix.lower() == ".toml":
        figure = draw_network(NetworkFile.read(file).network(impactlab.Network))
        say(f"{file} describes a network, which is drawn")
    else:
        result = load(file)
        if not isinstance(result, xr.Dataset):
            raise InvalidInput(f"{file} is the result of a study, whose figures lie beside it.")
        figure = overview(result)
    save_figure(figure, out)
    say(f"the figure is {out}")
    return DONE


def _simulate(options: argparse.Namespace) -> int:
    from impactlab.networks.network_file import SIMULATE, NetworkFile
    from impactlab.results.losses import LOSSES

    import_all(options.modules)
    file = NetworkFile.read(options.network)
    network = file.network(impactlab.Network)
    named = ("duration", "realizations", "seed", "records")
    given = {name: getattr(options, name) for name in named if getattr(options, name) is not None}
    arguments = _arguments(file, given)
    out = None if "tolerance" in arguments else options.out
    try:
        with engine(options, options.modules) as executor, _threads(options.workers) as threads:
            result = impactlab.simulate(
                network,
                progress=False if options.quiet else None,
                out=out,
                executor=threads if executor is None else executor,
                checkpoint=options.checkpoint,
                **arguments,
            )
    except InvalidInput as error:
        message = str(error).removeprefix("simulate: ")
        name = message.split()[0]
        if name in given or name not in file.options:
            raise
        raise file.refusal((SIMULATE, name), message) from error
    if options.out != out:
        impactlab.save(result, options.out)
    if not options.quiet:
        print(in_columns(list(_statistics(result))))
        if options.out:
            say(f"the result is {options.out}")
    return FAILED if LOSSES in result.attrs else DONE


def _threads(number: int | None) -> Any:
    """Return a context with so many threads, None for one a core."""
    from concurrent.futures import ThreadPoolExecutor

    from impactlab.studies.simulations import checked_workers

    checked_workers(number)
    return contextlib.nullcontext() if number is None else ThreadPoolExecutor(number)


def _arguments(file: Any, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of `simulate`: the options of the file, in whose place may be those that are given."""
    import inspect

    from impactlab.inputs import suggestion
    from impactlab.networks.network_file import SIMULATE

    own = set(inspect.signature(impactlab.simulate).parameters) - _GIVEN_HERE
    known = sorted(own | {"seed", "records"})
    for name in file.options:
        if name not in known:
            message = f"A simulation has no option {name!r}; {suggestion(name, known)}"
            raise file.refusal((SIMULATE, name), message)
    arguments = {**file.options, **given}
    records, integrator = arguments.pop("records", []), arguments.get("integrator")
    try:
        arguments["record"] = [_record(item) for item in (records if isinstance(records, list) else [records])]
    except InvalidInput as error:
        if "records" in given:
            raise
        raise file.refusal((SIMULATE, "records"), str(error)) from error
    if integrator is not None:
        data = {"type": integrator} if isinstance(integrator, str) else integrator
        arguments["integrator"] = impactlab.Integrator.from_dict(data)
    arguments["rng"] = arguments.pop("seed", None)
    return arguments


def _record(given: Any) -> impactlab.Record:
    """Return a record from its data, or from a text such as ``Density,quantity=velocity,bins=50``."""
    if not isinstance(given, str):
        return impactlab.Record.from_dict(given)
    name, *fields = re.split(r",(?=\s*\w+\s*=)", given)
    return impactlab.Record.from_dict({"type": name.strip(), **dict(map(_field, fields))})


def _field(text: str) -> tuple[str, Any]:
    """Return name and value of ``name=value``; quotes may be left out of a text."""
    from impactlab.toml_text import parsed_toml

    name, _, value = (part.strip() for part in text.partition("="))
    try:
        return name, parsed_toml(f"value = {value}", name)["value"]
    except InvalidInput:
        return name, value


def _statistics(result: xr.Dataset) -> Iterator[tuple[str, str, str, str]]:
    """Give rows of text with the statistics: name, label, value with standard error, units."""
    from impactlab.components.component import SHOWN
    from impactlab.results.measured import measured_text
    from impactlab.results.schema import STATISTICS

    for name in STATISTICS:
        if name not in result:
            continue
        values = result[name]
        errors = result.get(f"{name}_standard_error")
        labels = values[values.dims[0]].values.tolist()
        for index, label in enumerate(labels[:SHOWN]):
            error = math.nan if errors is None else errors.values[index].item()
            units = values.attrs.get("units", "1")
            yield name, label, measured_text(values.values[index].item(), error), "" if units == "1" else units
        if len(labels) > SHOWN:
            yield name, f"… {len(labels) - SHOWN} more", "", ""

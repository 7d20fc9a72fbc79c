"""What a notebook shows of a network: its drawing, and tables of what is known before a run."""

from __future__ import annotations

import html
import io
import itertools
import math
from collections.abc import Iterable, Iterator

import matplotlib
import numpy as np
import xarray as xr

import impactlab
from impactlab.components.composition import Composition
from impactlab.errors import ImpactLabError
from impactlab.inputs import checked
from impactlab.networks.check import MOST_BODIES, ROWS_OF_TABLE
from impactlab.plotting.captions import plain_text, side_text, with_units, words
from impactlab.plotting.drawing import draw_network
from impactlab.reference.conditions import reasons_of
from impactlab.reference.subsystems import spectral_density

_STYLE = "text-align:left;padding:0.1em 0.8em 0.1em 0"


@checked
def network_html(network: impactlab.Network) -> str:
    """Return a drawing of a network with tables, as HTML that needs no other file; notebooks show it.

    The tables have the natural frequencies, damping ratios and temperatures of the bodies, the contacts, the time step,
    and whether the stationary law is known exactly, with the reasons if it is not. Nothing is compiled or simulated.

    Parameters
    ----------
    network : Network
        What to describe.

    Returns
    -------
    str

    Raises
    ------
    InvalidInput
        If something else than a network is given.

    Examples
    --------
    >>> il.plot.network_html(network)[:4]
    '<div'
    """
    columns: tuple[str, ...] = ("body", "mass", "natural frequency", "damping ratio", "temperature")
    parts = [_svg(network), _table(columns, _bodies(network), len(network.oscillators))]
    try:
        with np.errstate(all="ignore"):  # of what never settles
            check = impactlab.NetworkCheck.of(network, most_modes=0).dataset
    except ImpactLabError as error:
        parts.append(_paragraph("Step", [str(error)]))
    else:
        columns = ("contact", "between", "law", "clearance", "shortest contact")
        parts.append(_table(columns, _contacts(network, check.shortest_contact.values), len(network.contacts)))
        parts.append(_paragraph("Step", [_step(check)]))
    if len(network.oscillators) > MOST_BODIES:
        parts.append(_paragraph("Stationary law", ["il.exact(network) tells whether it is known."]))
    else:
        reasons = reasons_of(network)
        known_law = "known exactly: il.exact(network)" if not reasons else "not known exactly:"
        parts.append(_paragraph("Stationary law", [known_law], reasons))
    return f'<div style="font-size:90%">{"".join(part for part in parts if part)}</div>'


def _svg(network: impactlab.Network) -> str:
    """Return the drawing as an element of HTML, the same text every time."""
    buffer = io.StringIO()
    figure = draw_network(network)
    with matplotlib.rc_context({"svg.hashsalt": "impactlab", "svg.fonttype": "path"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None}, dpi=72)
    text = buffer.getvalue()
    width = figure.get_figwidth()
    return f'<div style="max-width:{width:.1f}in">{text[text.index("<svg") :]}</div>'


def _step(check: xr.Dataset) -> str:
    step, refusals = check.attrs["step"], check.refusal.values
    if not np.isfinite(step):
        return " ".join(dict.fromkeys(str(item) for item in refusals if item)) or "any"
    return f"{step:.3g} s, {check.attrs['integrator']}. {check.attrs['run']}"


def _bodies(network: Composition) -> Iterator[list[str]]:
    for name, body in network.oscillators.items():
        density = spectral_density(network, name)
        heated = density is not None and density > 0.0 and body.damping > 0.0
        frequency, mass = body.natural_frequency, plain_text(with_units(body.mass, "kg"))
        if body.moves_as_given:
            yield [name, "", "moves as given", "", ""]
            continue
        yield [
            name, mass, plain_text(with_units(frequency, "rad s-1")) if frequency else "free",
            f"{body.damping_ratio:.3g}" if frequency else "",
            plain_text(with_units(math.pi * density / body.damping, "J")) if heated and density else "",
        ]  # fmt: skip


def _contacts(network: impactlab.Network, durations: Iterable[float]) -> Iterator[list[str]]:
    for (name, contact), duration in zip(network.named_contacts.items(), durations, strict=True):
        shortest = plain_text(with_units(float(duration), "s")) if np.isfinite(duration) else ""
        between = f"{side_text(contact.first)} and {side_text(contact.second)}"
        yield [name, between, words(contact.law), plain_text(with_units(contact.clearance, "m")), shortest]


def _table(columns: Iterable[str], rows: Iterator[list[str]], count: int) -> str:
    """Return a table without columns that are empty; of many rows the first ones."""
    lines = list(itertools.islice(rows, ROWS_OF_TABLE))
    used = [place for place, _ in enumerate(columns) if any(row[place] for row in lines)]
    if not used:
        return ""
    head = [[name for place, name in enumerate(columns) if place in used]]
    shown = [[row[place] for place in used] for row in lines]
    if count > ROWS_OF_TABLE:
        shown.append([f"… {count - ROWS_OF_TABLE} more"])
    text = ""
    for tag, some in (("th", head), ("td", shown)):
        for row in some:
            cells = "".join(f'<{tag} style="{_STYLE}">{html.escape(cell)}</{tag}>' for cell in row)
            text += f"<tr>{cells}</tr>"
    return f"<table>{text}</table>"


def _paragraph(title: str, sentences: Iterable[str], points: Iterable[str] = ()) -> str:
    items = [f"<li>{html.escape(point)}</li>" for point in points]
    if len(items) > ROWS_OF_TABLE:
        items = [*items[:ROWS_OF_TABLE], f"<li>… {len(items) - ROWS_OF_TABLE} more</li>"]
    text = html.escape(" ".join(sentences).strip())
    listed = f"<ul>{''.join(items)}</ul>" if items else ""
    return f"<p><b>{title}:</b> {text}</p>{listed}"

"""The report of a study: one page in HTML that needs no other file, for screens of any size and for paper.

Claims come first, each with a link to the figure that shows it.
"""

from __future__ import annotations

import base64
import html
import shlex
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from impactlab.studies.claims import VERDICTS
from impactlab.studies.discovery import toml
from impactlab.studies.study import StudyResult

if TYPE_CHECKING:
    import xarray as xr

CLAIM_COLUMNS = ("section", "statement", "measured", "verdict")
FURTHER_COLUMNS = ("criterion", "figure")

_STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff; max-width: 62rem; margin: 1.5rem auto;
       padding: 0 1rem; overflow-wrap: break-word; }
h1 { font-size: 1.6rem; line-height: 1.25; margin-bottom: 0; } h2 { font-size: 1.25rem; margin-top: 2.5rem; }
a { color: #00558c; } .quiet, details { color: #595959; } small { font-size: 0.85em; }
nav { position: sticky; top: 0; background: #fff; border-bottom: 1px solid #ddd; padding: 0.5rem 0; z-index: 1; }
nav a { margin-right: 1.1rem; display: inline-block; }
h2, figure, tr { scroll-margin-top: 3.5rem; }
figure { margin: 2rem 0; } figure div { overflow-x: auto; }
figure img { display: block; max-width: 100%; height: auto; }
table { border-collapse: collapse; width: 100%; font-size: 0.9rem; }
th, td { text-align: left; vertical-align: top; padding: 0.35rem 0.6rem; border-bottom: 1px solid #ddd; }
th { border-bottom: 2px solid #888; } td:last-child { white-space: nowrap; }
td[data-column="statement"] { width: 38%; }
tr:target, figure:target { background: #fff8dc; }
pre { background: #f4f4f4; padding: 0.8rem; overflow-x: auto; }
.good { color: #00694c; font-weight: 600; } .bad { color: #b03a00; font-weight: 600; }
.partly { color: #8a6100; font-weight: 600; } .unknown { color: #555; font-weight: 600; }
@media (max-width: 40rem) {
  nav { position: static; }
  thead { display: none; } tr { display: block; padding: 0.6rem 0; border-bottom: 1px solid #bbb; }
  td, td:last-child, td[data-column="statement"] { display: block; width: auto; white-space: normal; border: 0;
                                                   padding: 0.1rem 0; }
  td::before { content: attr(data-column) ": "; color: #595959; } td:empty { display: none; }
  figure img { max-width: none; width: 40rem; }
}
@media print {
  body { max-width: none; margin: 0; font-size: 10pt; } a { color: inherit; text-decoration: none; }
  nav, details { display: none; }
  figure, tr, pre { break-inside: avoid; } h2 { break-after: avoid; } thead { display: table-header-group; }
  figure img { max-height: 22cm; } pre { white-space: pre-wrap; }
}
"""

_CLASSES = {
    "holds": "good",
    "holds partly": "partly",
    "does not hold": "bad",
    "sampling error": "partly",
    "not testable": "unknown",
    "passed": "good",
    "failed": "bad",
}


class _Markup(str):
    """Text that is HTML already."""

    __slots__ = ()


def report(result: StudyResult, pictures: Mapping[str, bytes]) -> str:
    """Return the report of a study, with its figures as SVG."""
    study, text = result.study, html.escape
    numbers = {name: number for number, name in enumerate(pictures, start=1)}
    claims = claim_rows(result.claims)
    checks = [
        {"check": check.name, "detail": check.detail, "result": "passed" if check.ok else "failed"}
        for check in result.checks
    ]
    settings = [
        {"setting": name, "value": value, "units": study.units_of(name)} for name, value in study.settings().items()
    ]
    again = (
        f"<pre>{text(command(result))}</pre>\n<p>or with this file as <code>study.toml</code>: "
        f"<code>impactlab run study.toml</code></p>\n<pre>{text(toml(study))}</pre>"
    )
    sections = {
        "Claims": _table([_claim_cells(row, numbers) for row in claims], "claim"),
        "Figures": "\n".join(_figure(result, name, numbers[name], pictures[name], claims) for name in pictures),
        "Checks": _table(checks),
        **{title: _table(rows) for title, rows in study.tables(result.tree)},
        "Settings": _table(settings),
        "How to run it again": again,
    }
    sections = {title: content for title, content in sections.items() if content}
    links = "".join(f'<a href="#{_anchor(title)}">{text(title)}</a>' for title in sections)
    source = f"{result.tree.attrs['source']}, {result.tree.attrs['history'].split(' ')[0]}"
    parts = [
        f"<h1>{text(study.title)}</h1>",
        f'<p class="quiet">Study {text(study.name)}, {text(source)}</p>',
        f"<p>{text(summary(result))}</p>",
        f"<nav>{links}</nav>",
        *(f'<h2 id="{_anchor(title)}">{text(title)}</h2>\n{content}' for title, content in sections.items()),
    ]
    head = (
        '<meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{text(study.title)}</title><style>{_STYLE}</style>"
    )
    body = "\n".join(parts)
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n'


def _claim_cells(row: Mapping[str, str], numbers: Mapping[str, int]) -> dict[str, Any]:
    """Return the cells of a claim, with a link to its figure."""
    statement = html.escape(row["statement"])
    if row["criterion"]:
        statement += f'<br><small class="quiet">{html.escape(row["criterion"])}</small>'
    number = numbers.get(row["figure"])
    link = f'<a href="#figure-{number}">figure {number}</a>' if number else ""
    cells = {name: row[name] for name in CLAIM_COLUMNS}
    return cells | {"statement": _Markup(statement)} | ({"shown in": _Markup(link)} if numbers else {})


def _figure(result: StudyResult, name: str, number: int, svg: bytes, claims: Iterable[Mapping[str, str]]) -> str:
    """Return a figure with its caption, and with the claims that it shows."""
    caption = html.escape(result.study.caption(name))
    shown = [
        f'<li>{_verdict(row["verdict"])} <a href="#claim-{place}">{html.escape(row["statement"])}</a></li>'
        for place, row in enumerate(claims, start=1)
        if row["figure"] == name
    ]
    told = f"{len(shown)} claim{'s' if len(shown) > 1 else ''}"
    below = f"<details><summary>{told}</summary><ul>{''.join(shown)}</ul></details>" if shown else ""
    data = base64.b64encode(svg).decode()
    return (
        f'<figure id="figure-{number}"><div><img alt="{caption}" src="data:image/svg+xml;base64,{data}"></div>'
        f"<figcaption><b>Figure {number}.</b> {caption}{below}</figcaption></figure>"
    )


def _verdict(verdict: str) -> str:
    return f'<span class="{_CLASSES.get(verdict, "")}">{html.escape(verdict)}</span>'


def _anchor(title: str) -> str:
    return html.escape("-".join(title.lower().split()))


def claim_rows(claims: xr.Dataset) -> list[dict[str, str]]:
    """Return the claims as rows of text; what a study does not give is empty."""
    if "claim" not in claims.dims:
        return []
    columns = {name: [str(value) for value in claims[name].values] for name in CLAIM_COLUMNS}
    for name in FURTHER_COLUMNS:
        given = name in claims
        columns[name] = [str(value) for value in claims[name].values] if given else [""] * claims.sizes["claim"]
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _claim_counts(claims: xr.Dataset) -> dict[str, int]:
    """Return how many claims got each verdict, those that none got left out."""
    counts = Counter(row["verdict"] for row in claim_rows(claims))
    return {verdict: counts[verdict] for verdict in (*VERDICTS, *sorted(set(counts) - {*VERDICTS})) if counts[verdict]}


def summary(result: StudyResult) -> str:
    """Return one line on the checks and the claims."""
    passed = sum(bool(check.ok) for check in result.checks)
    parts = [f"{passed} of {len(result.checks)} checks passed"] if result.checks else []
    counts = _claim_counts(result.claims)
    if counts:
        verdicts = ", ".join(f"{verdict} {count}" for verdict, count in counts.items())
        parts.append(f"{sum(counts.values())} claims: {verdicts}")
    return "; ".join(parts) + "." if parts else "The study has no checks and no claims."


def command(result: StudyResult) -> str:
    """Return the command that runs the study with the same settings."""
    default = type(result.study)().settings()
    lines = dict(line.split(" = ", 1) for line in toml(result.study).splitlines())
    changed = [f"{name}={lines[name]}" for name, value in result.study.settings().items() if value != default[name]]
    return shlex.join(["impactlab", "run", result.study.name, *(part for item in changed for part in ("--set", item))])


def _table(rows: Iterable[Mapping[str, Any]], name: str = "") -> str:
    """Return a table, nothing without rows; a name gives each row an anchor."""
    rows = list(rows)
    if not rows:
        return ""
    head = "".join(f"<th>{html.escape(str(column))}</th>" for column in rows[0])
    lines = [f'<tr id="{name}-{number}">' if name else "<tr>" for number in range(1, len(rows) + 1)]
    cells = ("".join(_cell(str(column), value) for column, value in row.items()) for row in rows)
    body = "\n".join(f"{line}{inside}</tr>" for line, inside in zip(lines, cells, strict=True))
    return f"<table><thead><tr>{head}</tr></thead><tbody>\n{body}\n</tbody></table>"


def _cell(column: str, value: Any) -> str:
    if isinstance(value, float):
        value = f"{value:.6g}"
    text, kind = value if isinstance(value, _Markup) else html.escape(str(value)), _CLASSES.get(str(value), "")
    style = f' class="{kind}"' if kind else ""
    return f'<td data-column="{html.escape(column)}"{style}>{text}</td>'

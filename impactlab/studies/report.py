"""The files of a study that is done: tree, figures, a report in one HTML file, and the manifest."""

from __future__ import annotations

import base64
import html
import shlex
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from impactlab.studies.claims import VERDICTS
from impactlab.studies.discovery import make_study, toml
from impactlab.studies.run_folder import FIGURES, REPORT, RESULT, Folder
from impactlab.studies.study import StudyResult, judged

if TYPE_CHECKING:
    import xarray as xr

DPI = 160
CLAIM_COLUMNS = ("section", "statement", "measured", "verdict")


def publish(result: StudyResult, folder: Folder, begin: float) -> None:
    """Write all files of a result; the manifest, which says that the run is complete, is the last.

    The folder is claimed for the study; `begin` is what `time.perf_counter` read when the run began.
    """
    from impactlab.results.dataset import save

    files = {RESULT: save(result.tree, folder.path / RESULT)}
    pictures = _pictures(result)
    for name, png in pictures.items():
        files[f"{FIGURES}/{name}.png"] = folder.write(f"{FIGURES}/{name}.png", png)
    files[REPORT] = folder.write(REPORT, report(result, pictures).encode())
    folder.write_manifest(
        result.study,
        complete=True,
        wall_time=round(time.perf_counter() - begin, 3),
        passed=result.passed,
        checks=[{**check._asdict(), "ok": bool(check.ok)} for check in result.checks],
        files=files,
    )
    folder.clean(list(files))


def republish(folder: Folder) -> StudyResult:
    """Judge and draw a complete result again, with the study that is installed now; refuse an incomplete one."""
    begin = time.perf_counter()
    manifest = folder.manifest()
    study = make_study(manifest["study"], manifest["settings"])
    result = judged(study, folder.load_result(), folder.path)
    publish(result, folder, begin)
    return result


def _pictures(result: StudyResult) -> dict[str, bytes]:
    """Return the figures as PNG."""
    from impactlab.plotting.style import png, style

    pictures = {}
    for name, figure in result.figures.items():
        with style():
            pictures[name] = png(figure, DPI)
    return pictures


def claim_rows(claims: xr.Dataset) -> list[dict[str, str]]:
    """Return the claims as rows of text."""
    if "claim" not in claims.dims:
        return []
    columns = {name: [str(value) for value in claims[name].values] for name in CLAIM_COLUMNS}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def claim_counts(claims: xr.Dataset) -> dict[str, int]:
    """Return how many claims got each verdict, those that none got left out."""
    counts = Counter(row["verdict"] for row in claim_rows(claims))
    return {verdict: counts[verdict] for verdict in (*VERDICTS, *sorted(set(counts) - {*VERDICTS})) if counts[verdict]}


_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem;
       margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: 0; } h2 { font-size: 1.2rem; margin-top: 2.5rem; }
.quiet { color: #666; } figure { margin: 1.5rem 0; } figure img { max-width: 100%; }
figcaption { color: #666; }
table { border-collapse: collapse; width: 100%; font-size: 0.9rem; }
th, td { text-align: left; vertical-align: top; padding: 0.35rem 0.6rem; border-bottom: 1px solid #ddd; }
th { border-bottom: 2px solid #888; } td:last-child, .number { white-space: nowrap; }
pre { background: #f4f4f4; padding: 0.8rem; overflow-x: auto; }
.good { color: #00694c; font-weight: 600; } .bad { color: #b03a00; font-weight: 600; }
.partly { color: #8a6100; font-weight: 600; } .unknown { color: #555; font-weight: 600; }
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


def report(result: StudyResult, pictures: Mapping[str, bytes]) -> str:
    """Return the report of a study, with its figures as PNG: one HTML text that needs no other file."""
    study, text = result.study, html.escape
    source = f"{result.tree.attrs['source']}, {result.tree.attrs['history'].split(' ')[0]}"
    parts = [
        f"<h1>{text(study.title)}</h1>",
        f'<p class="quiet">Study {text(study.name)}, {text(source)}</p>',
    ]
    parts.append(f"<p>{text(summary(result))}</p>")
    for name, png in pictures.items():
        data = base64.b64encode(png).decode()
        caption = text(name.replace("_", " "))
        picture = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
        parts.append(f"<figure>{picture}<figcaption>{caption}</figcaption></figure>")
    checks = [
        {"check": check.name, "detail": check.detail, "result": "passed" if check.ok else "failed"}
        for check in result.checks
    ]
    tables = [("Claims", claim_rows(result.claims)), ("Checks", checks), *study.tables(result.tree)]
    for title, rows in tables:
        if rows:
            parts += [f"<h2>{text(title)}</h2>", _table(rows)]
    settings = [
        {"setting": name, "value": value, "units": study.units(name)} for name, value in study.settings().items()
    ]
    parts += ["<h2>Settings</h2>", _table(settings)] if settings else []
    parts += [
        "<h2>How to run it again</h2>",
        f"<pre>{text(command(result))}</pre>",
        f"<p>or with this file as <code>study.toml</code>: <code>impactlab run study.toml</code></p>"
        f"<pre>{text(toml(study))}</pre>",
    ]
    head = f'<meta charset="utf-8"><title>{text(study.title)}</title><style>{_STYLE}</style>'
    body = "\n".join(parts)
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n'


def summary(result: StudyResult) -> str:
    """Return one line on the checks and the claims."""
    passed = sum(bool(check.ok) for check in result.checks)
    parts = [f"{passed} of {len(result.checks)} checks passed"] if result.checks else []
    counts = claim_counts(result.claims)
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


def _table(rows: Iterable[Mapping[str, Any]]) -> str:
    rows = list(rows)
    head = "".join(f"<th>{html.escape(str(name))}</th>" for name in rows[0])
    lines = ["<tr>" + "".join(_cell(value) for value in row.values()) + "</tr>" for row in rows]
    return f"<table><thead><tr>{head}</tr></thead><tbody>\n" + "\n".join(lines) + "\n</tbody></table>"


def _cell(value: Any) -> str:
    if isinstance(value, float):
        value = f"{value:.6g}"
    kind = _CLASSES.get(str(value), "")
    return f'<td class="{kind}">{html.escape(str(value))}</td>' if kind else f"<td>{html.escape(str(value))}</td>"

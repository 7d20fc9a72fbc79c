"""The files of a study that is done: tree, figures, a report in one HTML file, and the manifest."""

from __future__ import annotations

import time

from impactlab.machine import uncollected
from impactlab.studies.discovery import make_study
from impactlab.studies.report_page import report
from impactlab.studies.run_folder import FIGURES, REPORT, RESULT, Folder
from impactlab.studies.study import StudyResult, judged


def publish(result: StudyResult, folder: Folder, begin: float) -> None:
    """Write all files of a result; the manifest, which says that the run is complete, is the last.

    The folder is claimed for the study; `begin` is what `time.perf_counter` read when the run began.
    """
    from impactlab.results.dataset import save

    files = {RESULT: save(result.tree, folder.path / RESULT)}
    pictures = _pictures(result)
    for name, picture in pictures.items():
        files[f"{FIGURES}/{name}.svg"] = folder.write(f"{FIGURES}/{name}.svg", picture)
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
    """Return the figures as SVG."""
    from impactlab.plotting.style import style, svg

    with style(), uncollected():
        return {name: svg(figure) for name, figure in result.figures.items()}

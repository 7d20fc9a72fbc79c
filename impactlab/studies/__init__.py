"""Studies: simulations that are configured, run, judged and reported as one."""

from impactlab.studies.claims import VERDICTS, Check, Claim, checks_of, table_of
from impactlab.studies.folder_study import FolderStudy
from impactlab.studies.study import Item, Study, StudyResult, SweepItem

__all__ = [
    "VERDICTS",
    "Check",
    "Claim",
    "FolderStudy",
    "Item",
    "Study",
    "StudyResult",
    "SweepItem",
    "checks_of",
    "table_of",
]

"""Studies: simulations that are configured, run, judged and reported as one."""

from impactlab.studies.items import Item, SweepItem
from impactlab.studies.study import VERDICTS, Check, Study, StudyResult

__all__ = ["VERDICTS", "Check", "Item", "Study", "StudyResult", "SweepItem"]

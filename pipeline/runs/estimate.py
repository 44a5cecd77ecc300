"""Estimated cost of a stage: that of its last run, else that of single_finger, scaled."""

from pipeline.fea.sections import sections
from pipeline.fea.settings import UNCERTAIN_AT_KPA
from pipeline.runs.run import Run
from pipeline.runs.stages import BY_NAME, FEA
from pipeline.scene.predicted import predicted
from piv.files.record import read_record

# relative to coarse
_SCALE = {"smoke": 0.25, "draft": 0.5, "medium": 2.0, "fine": 4.0, "reference": 8.0}
_COUPLED = 1.4  # CPU time over that of a prescribed run: 1.1 to 1.5 in docs/coupling.md


def estimate(run: Run, stage: str, recorded: bool = True) -> tuple[float, float]:
    """CPU seconds and memory (MB) of a stage; `recorded`: of its last run, where there is one."""
    record = read_record(run.out, stage) if recorded else None
    if record is not None:
        return float(record["cpu_time"]), record["peak_memory"] / 1e6
    seconds, memory = BY_NAME[stage].cost
    if stage == FEA.name:
        fea = sections(run.scene)[1]
        more = 6 * len(UNCERTAIN_AT_KPA) if fea.uncertainty and fea.engine == "unit_cell" else 0
        return seconds * (len(fea.pressures) + more), memory
    scale = _SCALE.get(run.scene.level, 1.0)
    if BY_NAME[stage].ranks:
        size = predicted(run.scene)
        return size.cpu * (_COUPLED if run.scene.coupled else 1), max(memory, size.memory / 1e6)
    return seconds * scale, memory * max(1.0, scale)


def duration(seconds: float) -> str:
    """A time with a readable unit."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"

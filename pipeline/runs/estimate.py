"""Estimated cost of a stage: that of its last run, else that of single_finger, scaled."""

from pipeline.fea.sections import sections
from pipeline.fea.settings import UNCERTAIN_AT_KPA
from pipeline.runs.run import Run
from pipeline.runs.stages import FEA
from pipeline.scene.predicted import predicted
from piv.files.record import read_record

# relative to coarse
_SCALE = {"smoke": 0.25, "draft": 0.5, "medium": 2.0, "fine": 4.0, "reference": 8.0}


def estimate(run: Run, stage: str, recorded: bool = True) -> tuple[float, float]:
    """CPU seconds and memory (MB) of a stage; `recorded`: of its last run, where there is one."""
    record = read_record(run.out, stage) if recorded else None
    if record is not None:
        return float(record["cpu_time"]), record["peak_memory"] / 1e6
    step = run.stage(stage)
    seconds, memory = step.cost
    if stage == FEA.name:
        fea = sections(run.scene)[1]
        more = 6 * len(UNCERTAIN_AT_KPA) if fea.uncertainty and fea.engine == "unit_cell" else 0
        return seconds * (len(fea.pressures) + more), memory
    scale = _SCALE.get(run.scene.level, 1.0)
    if step.ranks:
        size = predicted(run.scene)
        return size.cpu * step.slower, max(memory, size.memory / 1e6)
    return seconds * scale, memory * max(1.0, scale)


def duration(seconds: float) -> str:
    """A time with a readable unit."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"

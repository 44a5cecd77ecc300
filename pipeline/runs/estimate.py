"""Estimated cost of a stage: that of its last run, else that of single_finger, scaled."""

from pipeline.fea.sections import sections
from pipeline.fea.settings import UNCERTAIN_AT_KPA
from pipeline.runs.run import Run
from pipeline.runs.stages import FEA, FILMED, STAGES
from pipeline.scene.predicted import predicted
from piv.files.record import read_record

# relative to coarse
_SCALE = {"smoke": 0.5, "draft": 0.75, "medium": 2.0, "fine": 4.0, "reference": 8.0}
# sizes of single_finger at coarse, whose costs the stages state, and their number of instants
_SIZES = {
    "samples": (2.02e7, "pictures", 210),
    "pixels": (2.75e8, "frames", 210),
    "vectors": (2.15e6, "fields", 105),
}
_EACH = 0.25  # of such a cost: what an instant takes however few its points are
_FLOW_ALONE = 0.7  # of the pictures of a page with PIV: the slider has one field, not three
# in a plane flow more vortices are found and fitted
_PLANE_VORTICES = 2.0
_START = 0.5  # s of any stage: its process, and what it imports


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
    if stage == "figures" and not run.scene.filmed:
        scale *= _FLOW_ALONE
    if step.ranks:
        size = predicted(run.scene)
        return size.cpu + _START, max(memory, size.memory / 1e6)
    # before the bending is analysed the view is not known, and neither are its pictures
    if step.grows and run.scene.camera.centre is not None:
        size, (points, name, instants) = predicted(run.scene), _SIZES[step.grows]
        scale = (1 - _EACH) * getattr(size, step.grows) / points
        scale += _EACH * getattr(size, name) / instants
        if step.group == "vortices" and run.scene.model.kind == "2d":
            scale *= _PLANE_VORTICES
        return seconds * scale + _START, memory
    return seconds * scale + _START, memory * max(1.0, scale)


def of_page(run: Run, recorded: bool = True) -> float:
    """CPU seconds of all stages that a run's page needs, without the bending analysis."""
    needed = (s.name for s in STAGES if run.scene.filmed or s.name not in FILMED)
    return sum(estimate(run, name, recorded)[0] for name in needed)


def duration(seconds: float) -> str:
    """A time with a readable unit."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"

"""How much small changes change the flow of level medium, by windows of the stroke.

    python -m docs.evidence.predictability

writes docs/tradeoff/predictability.csv. It takes about 40 minutes of CPU time.
"""

import pandas as pd

from docs.evidence.small_scene import ROOT
from pipeline.runs.run import Run, open_run
from postprocess.evidence.stage_files import StageFiles
from postprocess.tables import write_table
from softfinger.make import Machine, make
from softfinger.study.errors import errors_against, stroke_windows
from softfinger.study.table import middle_of_stroke, origin

_SCENE = ROOT / "cases" / "single_finger"
_RATE = {"sheet.rate_hz": 100}
_CHANGES = {
    "viscosity 1 % larger": {"fluid.kinematic_viscosity": 1.01404e-6},
    "half of the time step": {"numerics.time_step": 0.5e-3},
}
_SHOWN = ("error_near_tip", "error_circulation", "error_centre_mm", "error_force")


def flow(name: str, overrides: dict[str, float]) -> Run:
    """The run of level medium with some keys changed, made up to its vortices."""
    run = open_run(_SCENE, "medium", _RATE | overrides, _SCENE / "out" / "variations" / name)
    make(run, "vortices_cfd", Machine())
    return run


def main() -> None:
    """Make the runs and write their differences from the unchanged one."""
    files = StageFiles(flow("medium_100_hz", {}).scene)
    windows = stroke_windows(middle_of_stroke(files), files.numbers.motion.end_time)
    rows = []
    for number, (change, overrides) in enumerate(_CHANGES.items()):
        other = StageFiles(flow(f"medium_change_{number}", overrides).scene)
        for start, end in windows:
            found = errors_against(files, other, "cfd", (start, end))
            window = {"change": change, "start_s": round(start, 4), "end_s": round(end, 4)}
            rows.append(window | {name: float(f"{found[name]:.2g}") for name in _SHOWN})
    plan = {"folder": str(_SCENE), "level": "medium", "until": "vortices_cfd", "overrides": _RATE}
    head = origin([plan | {"out": str(files.out), "compared_ranks": None}])
    write_table(ROOT / "docs" / "tradeoff" / "predictability.csv", pd.DataFrame(rows), head)


if __name__ == "__main__":
    main()

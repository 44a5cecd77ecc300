"""THE table of stages: make and Snakemake rules, studies, estimates, reports and `make help` follow from it.

It lies here because stages meet in files alone, and every package that reads those files may read this.
`python -m fileio.stages > fileio/stages.mk` writes what make reads of it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Stage:
    """A step from files to files in `<scene>/out/<level>`.

    `outputs`: the first says that the stage is done. `sections`: what of the scene its result depends on, besides its
    inputs. `format`: of the first output, a new version of which makes the stage again. `group`: stages with one settings
    file and one make target. `piv`: the command of piv that it is.
    `columns`: those of a study's table that its result depends on. `cost`: CPU seconds and memory (MB) of single_finger
    at level coarse.
    """

    name: str
    module: str
    about: str
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    sections: dict[str, Any] = field(default_factory=dict)
    format: str = ""
    group: str = ""
    piv: str = ""
    columns: tuple[str, ...] = ()
    cost: tuple[float, float] = (60, 500)
    ranks: bool = False  # solves through MPI: its cost grows with the level
    threads: bool = False
    shared: bool = True  # by the runs of a study that have the same settings up to it
    temporary: bool = False  # large, and read by the next stage alone: may be deleted after that

    @property
    def target(self) -> str:
        """Name of its settings file and make target."""
        return self.group or self.name

    @property
    def settings(self) -> tuple[str, ...]:
        """The files that it is made again for, besides those of the stages before it."""
        return (f"settings/{self.target}.json",) * bool(self.sections) + (
            f"settings/{self.target}.format",
        ) * bool(self.format)

    @property
    def done(self) -> str:
        """The file that says that it is done."""
        return self.outputs[0]


SHEET_GRID = {
    "columns",
    "rows",
    "scale_mm_per_px",
    "centre",
}  # of the camera: the sheet covers its view
STAGES = (
    Stage("kinematics", "pipeline.kinematics.stage", "pressure law and shapes of the finger", (),
          ("kinematics.h5",), dict.fromkeys(("tank", "finger", "body", "pinch", "support", "motion"), True),
          "kinematics", cost=(5, 400)),
    # an interval begins with a picture of the sheet, and its shapes cover an overlap of so many time steps
    Stage("mesh", "pipeline.mesh.stage", "planform meshes and the shapes that move them", ("kinematics",),
          ("planform.h5", "mesh_quality.csv"),
          {"mesh": True, "model": True, "support": True, "numerics": {"time_step"}, "sheet": {"rate_hz"}},
          "planform", cost=(40, 500)),
    # the solver needs no more of the sheet than this: a finer grid does not solve again
    Stage("case", "pipeline.case", "OpenFOAM case", ("mesh",), ("sweep.h5",),
          {"fluid": True, "numerics": True, "sheet": {"rate_hz", "z"}},
          "sweep", columns=("ranks",), cost=(10, 500)),  # a run writes into its folder
    Stage("run", "pipeline.run.stage", "the flow, by OpenFOAM", ("case",),
          ("run/run.json", "run/history.csv", "run/power.csv", "run/forces.csv", "case"),
          format="run", cost=(300, 600), ranks=True),
    Stage("sheet", "pipeline.sheet", "the flow in the laser sheet", ("run",), ("sheet.h5",),
          {"sheet": {"spacing", "margin"}, "camera": SHEET_GRID}, "plane-series"),
    Stage("images", "piv", "what the camera would see", ("sheet",), ("images.h5", "images_truth.h5"),
          {"camera": True, "sheet": True}, "recording", piv="render", cost=(120, 600), temporary=True),
    Stage("piv", "piv", "vectors from the images", ("images",), ("piv.h5",), {"piv": True},
          "plane-series", piv="correlate", columns=("piv_chunks",), cost=(120, 800), threads=True),
    Stage("vortices_cfd", "piv", "vortices of the CFD", ("sheet",), ("vortices_cfd.csv",), {"vortices": True},
          "vortices", "vortices", piv="vortices", threads=True),
    Stage("vortices_piv", "piv", "vortices of the PIV", ("piv",), ("vortices_piv.csv",), {"vortices": True},
          "vortices", "vortices", piv="vortices", threads=True),
    Stage("compare", "postprocess.compare.stage", "CFD and PIV against the scene's findings",
          ("vortices_cfd", "vortices_piv"), ("comparison.json", "comparison.csv"), format="comparison", cost=(30, 600), shared=False),
    Stage("loads", "pipeline.structure.stage", "the water's loads on the finger, and what they would bend", ("run",),
          ("loads.h5",), {"structure": {"bending_stiffness", "damping"}}, "finger-loads", cost=(14, 500)),
    Stage("figures", "postprocess.report.figures", "pictures of the report", ("compare", "loads"),
          ("figures/figures.json",), format="figures", cost=(60, 900), threads=True, shared=False),
    Stage("report", "postprocess.report.stage", "report.html", ("figures",), ("report.html",), {"title": True},
          cost=(30, 900), shared=False),
)  # fmt: skip
# Only where it is asked for (make fea); its result lies in the scene's folder, for all levels.
FEA = Stage("fea", "pipeline.fea.stage", "bending states of the actuator", (), ("kinematics/states.h5",),
            cost=(300, 600))  # fmt: skip
BY_NAME = {stage.name: stage for stage in (FEA, *STAGES)}


def until(target: str, stages: tuple[Stage, ...] = STAGES) -> list[Stage]:
    """The stages that a stage or a group of them needs, and those themselves, in order."""
    needed = {stage.name for stage in stages if target in (stage.name, stage.target)}
    for stage in reversed(stages):
        if stage.name in needed:
            needed.update(stage.inputs)
    return [stage for stage in stages if stage.name in needed]


def make_variables(stages: tuple[Stage, ...] = STAGES) -> str:
    """What make reads of the table."""
    groups = {stage.group for stage in stages if stage.group}
    files = {stage.name: stage.done for stage in stages}
    lines = [
        "# Written by: python -m fileio.stages > fileio/stages.mk",
        f"STAGES := {' '.join(files)}",
        f"TARGETS := {' '.join(dict.fromkeys(stage.target for stage in stages))}",
    ]
    for name in sorted(groups):
        lines += [
            f"GROUPS += {name}",
            f"OF.{name} := {' '.join(s.name for s in stages if s.group == name)}",
        ]
    for stage in stages:
        needs = [files[name] for name in stage.inputs]
        needs += stage.settings
        given = " ".join(
            f"$({word.upper()})" for word in ("ranks", "threads") if getattr(stage, word)
        )
        lines += [f"FILE.{stage.name} := {stage.done}", f"NEEDS.{stage.name} := {' '.join(needs)}"]
        lines += [f"OPTIONS.{stage.name} = {given}"] if given else []
        lines += [f"ABOUT.{stage.name} := {stage.about}"]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(make_variables(), end="")

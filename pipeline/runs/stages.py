"""The table of stages: runs, studies, estimates, reports and `softfinger stages` follow from it."""

from dataclasses import dataclass, field, replace
from typing import Any


@dataclass(frozen=True)
class Stage:
    """A step from files to files in a run's folder.

    module: has run(scene, quiet, **options), or is a command of piv where `piv`.
    outputs: patterns of files; the next stages read the first. folders: linked whole into an equal
    run. sections: keys of the scene that the result depends on, True for all. version: a new one
    makes results stale. by_sources: each change of its code makes results stale, too. cost: CPU
    seconds and memory (MB) of single_finger at level coarse, measured; of fea CPU seconds by
    bending state. grows: the attribute of a scene's predicted size that it is in proportion to.
    """

    name: str
    module: str
    about: str
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    sections: dict[str, Any] = field(default_factory=dict)
    version: int = 1
    group: str = ""
    piv: bool = False
    folders: tuple[str, ...] = ()
    cost: tuple[float, float] = (0, 0)
    grows: str = ""
    ranks: bool = False  # solves through MPI: its cost grows with the level
    threads: bool = False
    by_sources: bool = False
    temporary: bool = False  # large: may be deleted once its readers are done
    sealed: bool = False  # OpenFOAM runs it: another clone's is made again

    @property
    def done(self) -> str:
        """The file that the next stages read."""
        return self.outputs[0]


_SHEET_GRID = {
    "columns",
    "rows",
    "scale_mm_per_px",
    "centre",
}  # camera keys that set the grid of the sheet
_MOTION = ("tank", "finger", "body", "pinch", "support", "obstacle", "motion")
FEA = Stage(
    "fea", "pipeline.structure.fea_stage", "bending states of the actuator",
    outputs=("states.h5",), sections={"actuator": True, "fea": True}, cost=(1.5, 600),
    threads=True,
)  # fmt: skip
STAGES = (
    Stage(
        "kinematics", "pipeline.kinematics.stage", "pressure history and shapes of the finger",
        outputs=("kinematics.h5",), sections=dict.fromkeys(_MOTION, True),
        cost=(1, 400),
    ),
    # an interval begins with a picture of the sheet, and its shapes overlap by some time steps
    Stage(
        "mesh", "pipeline.mesh.stage", "planforms that follow the motion",
        ("kinematics",), ("planform.h5", "mesh_quality.csv"),
        {"mesh": True, "model": True, "support": True, "numerics": {"time_step"},
         "sheet": {"rate_hz"}},
        cost=(7, 500),
    ),
    # the solver uses only these keys of the sheet, so that a finer grid needs no new solution
    Stage(
        "case", "pipeline.case.stage", "the OpenFOAM case",
        ("mesh",),
        # all but system/numbers and decomposeParDict, which the stage solve writes
        ("sweep.h5", "case/*/0*/*", "case/*/constant/*", "case/*/constant/polyMesh/*",
         "case/*/constant/boundaryData/upstream/*", "case/*/constant/boundaryData/upstream/*/*",
         "case/*/system/[!dn]*"),
        {"fluid": True, "numerics": True, "sheet": {"rate_hz", "z"}, "current": True},
        folders=("case",), cost=(1, 500), temporary=True, sealed=True,
    ),
    Stage(
        "solve", "pipeline.solve.stage", "the flow, by OpenFOAM; resumes after an interruption",
        ("case",), ("run/run.json", "run/*.csv", "run/*.h5", "case/*/postProcessing/*/*/*.vtk"),
        folders=("case",), cost=(160, 600), ranks=True, temporary=True,
    ),
    Stage(
        "sheet", "pipeline.sheet", "the flow in the laser sheet",
        ("solve",), ("sheet.h5",), {"sheet": {"spacing", "margin", "every"}, "camera": _SHEET_GRID},
        cost=(14, 500), grows="samples",
    ),
    Stage(
        "images", "piv.commands.render", "what a camera would see",
        ("sheet",), ("images.h5",), {"camera": True, "sheet": {"rate_hz", "thickness"}},
        piv=True, cost=(40, 600), grows="pixels", temporary=True,
    ),
    Stage(
        "piv", "piv.commands.correlate", "vectors of those images",
        ("images",), ("piv.h5",), {"piv": True},
        version=5, piv=True, cost=(25, 800), grows="vectors", threads=True,
    ),
    Stage(
        "pressure", "piv.commands.pressure", "the water's pressure and loads, from those vectors",
        ("piv",), ("pressure.h5",), {"fluid": {"density", "kinematic_viscosity"}},
        version=2, piv=True, cost=(24, 600), grows="vectors",
    ),
    Stage(
        "vortices_cfd", "piv.commands.vortices", "vortices of the CFD and their tracks",
        ("sheet",), ("vortices_cfd.csv",), {"vortices": True},
        group="vortices", piv=True, cost=(16, 500), grows="samples", threads=True, by_sources=True,
    ),
    Stage(
        "vortices_piv", "piv.commands.vortices", "vortices of the PIV and their tracks",
        ("piv",), ("vortices_piv.csv",), {"vortices": True},
        group="vortices", piv=True, cost=(5, 500), grows="vectors", threads=True, by_sources=True,
    ),
    Stage(
        "compare", "postprocess.compare.stage", "CFD and PIV against the scene's findings",
        ("vortices_cfd", "vortices_piv", "kinematics", "solve", "sheet", "piv"),
        ("comparison.json", "comparison.csv", "pairs_*.csv", "centreline_*.csv", "integrals_*.csv"),
        {"name": True, "level": True, "filmed": True}, cost=(3, 600), by_sources=True,
    ),
    Stage(
        "loads", "pipeline.structure.stage", "the water's loads along the finger, and its energy",
        ("solve",), ("loads.h5",), {"structure": True},
        cost=(5, 500), by_sources=True,
    ),
    Stage(
        "figures", "postprocess.report.figures", "pictures of the report",
        ("compare", "vortices_cfd", "vortices_piv", "loads", "kinematics", "mesh", "solve", "sheet",
         "images", "piv", "pressure"),
        ("figures/figures.json", "figures/*", "figures/*/*"),
        cost=(35, 900), threads=True, by_sources=True,
    ),
    Stage(
        "report", "postprocess.report.stage", "the page, report.html",
        ("figures", "compare", "solve"), ("report.html",),
        {"title": True, "name": True, "level": True}, cost=(1, 900), by_sources=True,
    ),
)  # fmt: skip
_GUESSED = {"kinematics", "mesh"}
_STRUCTURE = {
    "structure": True, "fluid": True, "model": True, "numerics": {"time_step"}, "current": True,
}  # fmt: skip
BY_NAME = {stage.name: stage for stage in (FEA, *STAGES)}
# The rows of a coupled run in their place. Its solver gives the motion and the meshes: what
# kinematics and mesh have made is a first guess.
COUPLED = {
    stage.name: stage
    for stage in (
        replace(
            BY_NAME["kinematics"], module="pipeline.couple.first_motion",
            sections=BY_NAME["kinematics"].sections | _STRUCTURE,
        ),
        replace(BY_NAME["case"], version=4),
        replace(BY_NAME["solve"], module="pipeline.couple.stage", version=3),
        *(
            replace(stage, inputs=tuple(name for name in stage.inputs if name not in _GUESSED))
            for stage in STAGES if "solve" in stage.inputs and _GUESSED & {*stage.inputs}
        ),
    )
}  # fmt: skip
FILMED = {"images", "piv", "pressure", "vortices_piv"}  # stages of the camera and of PIV
TARGETS = tuple(dict.fromkeys(word for s in STAGES for word in (s.name, s.group) if word))


def until(target: str) -> list[Stage]:
    """A stage, or the stages of a group, and all their inputs, in order."""
    needed = {stage.name for stage in STAGES if target in (stage.name, stage.group)}
    for stage in reversed(STAGES):
        if stage.name in needed:
            needed.update(stage.inputs)
    return [stage for stage in STAGES if stage.name in needed]

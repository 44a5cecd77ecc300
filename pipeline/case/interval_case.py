"""The OpenFOAM case of one mesh interval, from templates and the swept mesh."""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy import ndarray

from pipeline.case.current_case import (
    samples_text,
    start_stream,
    wall_type,
    write_current,
)
from pipeline.formats.mesh_intervals import Interval
from pipeline.geometry.quality import cell_centres, planform_edges
from pipeline.geometry.sweep import (
    BODY_PATCHES,
    OUTER_PATCHES,
    PolyMesh,
    sweep_mesh,
    write_polymesh,
)
from pipeline.openfoam.base_case import BASE, template_files
from pipeline.openfoam.covering_columns import covering_cells
from pipeline.openfoam.displacement_files import Steps, checkpoint_steps, steps_of, time_name
from pipeline.openfoam.foamfile import write_bytes
from pipeline.openfoam.gate import add_gate
from pipeline.scene.current import LEAD, Current, Stream, lead_steps
from pipeline.scene.obstacle import OBSTACLE_PATCHES, forces_name
from pipeline.scene.scene import Scene
from piv.files.atomic import write_text

_SYMMETRIC = ("half", "quarter")
_INTERPOLATION = {"linear": "linear", "skewCorrected": "skewCorrected linear"}


def numbers(scene: Scene, interval: Interval, handover: float, back: float) -> dict[str, str]:
    """The entries of system/numbers for one interval.

    handover: time (s) of the fields that start the next interval; back: z (m) of the back wall.
    """
    kind = scene.model.kind
    flat, n = kind == "2d", scene.numerics
    sampling = n.sampling_steps(scene.sheet.rate_hz)
    sheet_z = 0.5 * back if flat else scene.sheet.z
    balance = n.balance_steps(scene.sheet.rate_hz)

    def point(*xyz: float) -> str:
        return f"({' '.join(f'{c:.10g}' for c in xyz)})"

    return {
        "timeStep": f"{n.time_step:.10g}",
        "startTime": time_name(interval.begin),
        "endTime": f"{interval.end:.10g}",
        "writeInterval": f"{n.time_step * checkpoint_steps(n.write_interval, n.time_step):.10g}",
        "handoverStep": str(steps_of(handover, n.time_step)),
        "sampleInterval": str(sampling),
        "balanceInterval": str(balance),
        "wallInterval": "1" if scene.coupled else str(balance),
        "meshMotion": "dynamicMotionSolverFvMesh" if interval.moving else "staticFvMesh",
        "timeScheme": n.time_scheme,
        "convectionScheme": n.convection,
        "interpolationScheme": _INTERPOLATION[n.interpolation],
        "density": f"{scene.fluid.density:.10g}",
        "viscosity": f"{scene.fluid.kinematic_viscosity:.10g}",
        "simulationType": "laminar" if scene.fluid.turbulence == "laminar" else "LES",
        "outerCorrectors": str(n.outer_correctors),
        "pressureCorrectors": str(n.pressure_correctors),
        "nonOrthogonalCorrectors": str(n.non_orthogonal_correctors),
        "momentPoint": point(*scene.finger.root, 0.0),
        "sheetType": "empty" if flat else "symmetryPlane",
        "backType": "empty" if flat else wall_type(scene.current),
        "backPressureType": "empty" if flat else "zeroGradient",
        "backPatchType": "empty" if flat else "patch",
        "frontType": wall_type(scene.current),
        "sheetSampling": "patch" if kind in _SYMMETRIC else "cuttingPlane",
        "sheetPoint": point(0, 0, sheet_z),
    }


def numbers_text(entries: dict[str, str]) -> str:
    """Return the text of the file system/numbers."""
    head = "// Every number of the case, from scene.toml; the stage solve writes it anew.\n"
    return head + "".join(f"{key:<23} {value};\n" for key, value in entries.items())


def write_numbers(
    scene: Scene,
    intervals: Sequence[Interval],
    interval: Interval,
    planform: xr.Dataset,
    name: str = "",
) -> None:
    """Write system/numbers of the case of one of the `intervals`; `name`: of its folder."""
    later = [each.begin for each in intervals if each.index == interval.index + 1]
    handover = (later or [interval.end])[0]
    entries = numbers(scene, interval, handover, float(planform["levels"].values[0]))
    path = scene.out / "case" / (name or interval.name) / "system" / "numbers"
    write_text(path, numbers_text(entries))


def obstacles_text(names: list[str]) -> str:
    """The file system/obstacles: the forces on each of these walls."""
    return "".join(
        ["// The forces on [[obstacle]] of scene.toml; written by the case stage.\n"]
        + [
            f'{forces_name(name)}\n{{\n    type forces; libs ("libforces.so"); patches ({name});\n'
            "    rho rhoInf; rhoInf $density; CofR $momentPoint;\n"
            "    writeControl timeStep; writeInterval 1; log no;\n}\n"
            for name in names
        ]
    )


def regions_text(kind: str) -> str:
    """The file system/regions: the wall that each zone of columns follows."""
    zones = {"behindSheet": "backZone"} | ({"beforeSheet": "frontZone"} if kind == "full" else {})
    text = (
        "// Columns of cells that follow one wall; the second zone is empty: nothing is"
        " interpolated.\n"
    )
    for zone, wall in zones.items():
        text += (
            f"{zone}\n{{\n    interpolationScheme oneSided;\n    boundaryField\n    {{\n"
            f"        {wall} {{ type follow; }}\n"
            "        emptyZone { type fixedValue; value uniform (0 0 0); }\n    }\n}\n"
        )
    return text


def sides(planform: xr.Dataset, current: Current | None = None) -> ndarray:
    """Index into OUTER_PATCHES for each edge on the tank's outline, 0 for the other edges.

    A `current` enters and leaves through the whole of the tank's ends.
    """
    nodes = planform["points"].values[0]
    edges = planform_edges(planform["triangles"].values, planform["quads"].values)
    left, _, right, top = planform.attrs["corners"]
    middle = nodes[edges.nodes].mean(1)
    tolerance = 1e-9
    side = np.zeros(len(middle), int)
    side[np.abs(middle[:, 1] - top) < tolerance] = OUTER_PATCHES.index("top")
    mirrored = bool(planform.attrs["mirror"])
    for x in (left, right):
        wall = np.flatnonzero(np.abs(middle[:, 0] - x) < tolerance)
        if x == right and mirrored:
            side[wall] = OUTER_PATCHES.index("mirror")
        elif current is not None:
            enters = (x == left) == (current.sign > 0)
            side[wall] = OUTER_PATCHES.index("upstream" if enters else "downstream")
        else:
            side[wall[np.argmax(middle[wall, 1])]] = OUTER_PATCHES.index("gap")
    return side


def build_mesh(planform: xr.Dataset, current: Current | None = None) -> PolyMesh:
    """Sweep one mesh of `planform.h5`; `current`: of the scene."""
    return sweep_mesh(planform, sides(planform, current))


def patch_types(kind: str) -> dict[str, str]:
    """OpenFOAM's type of each patch.

    The tank's sides are patches: v1912 recomputes distances from walls whenever the mesh moves.
    """
    flat = kind == "2d"
    return dict.fromkeys(BODY_PATCHES, "wall") | {
        **dict.fromkeys(OUTER_PATCHES, "patch"),
        "mirror": "symmetryPlane",
        "back": "empty" if flat else "patch",
        "front": "patch",
        "sheet": "empty" if flat else "symmetryPlane",
    }


def zones(mesh: PolyMesh, planform: xr.Dataset) -> tuple[dict[str, ndarray], dict[str, ndarray]]:
    """Face zones that drive the motion, and the zones of cells whose points follow them.

    A cell zone holds only the cells that touch all points: v1912 searches it in every time step.
    """
    levels, kind = planform["levels"].values, str(planform.attrs["model"])
    triangles = planform["triangles"].values
    corners = np.vstack([triangles[:, [0, 1, 2, 2]], planform["quads"].values])
    span = {name: np.arange(start, start + count) for name, start, count in mesh.patches}
    faces = {"backZone": span["back"], "emptyZone": np.array([], int)}
    cells = covering_cells(corners, mesh.cell_column, mesh.cell_layer)
    if kind != "full":
        return faces, {"behindSheet": cells}
    behind = 0.5 * (levels[1:] + levels[:-1])[mesh.cell_layer[cells]] < 0
    return faces | {"frontZone": span["front"]}, {
        "behindSheet": cells[behind],
        "beforeSheet": cells[~behind],
    }


def write_interval(
    scene: Scene,
    intervals: Sequence[Interval],
    interval: Interval,
    planform: xr.Dataset,
    mesh: PolyMesh,
    nodes: ndarray,
    name: str = "",
) -> None:
    """Write the case of one of the `intervals`.

    `nodes` (node, 2) m: at its begin; `name`: of a folder in place of the interval's.
    """
    name = name or interval.name
    folder, kind = scene.out / "case" / name, str(planform.attrs["model"])
    for path in template_files():
        write_bytes(folder / path.relative_to(BASE), path.read_bytes())
    if interval.index or (name != LEAD and lead_steps(scene)):
        (folder / "0").rename(folder / "0.orig")  # the stage solve maps fields into them
    write_numbers(scene, intervals, interval, planform, name)
    write_text(folder / "system" / "regions", regions_text(kind))
    walls = [name for name, _, _ in mesh.patches if name in OBSTACLE_PATCHES]
    through = samples_text([name for name, _, _ in mesh.patches]) if scene.current else ""
    write_text(folder / "system" / "obstacles", obstacles_text(walls) + through)
    faces, cells = zones(mesh, planform)
    points = mesh.points(nodes, planform["levels"].values)
    write_polymesh(mesh, points, folder / "constant" / "polyMesh", patch_types(kind), faces, cells)
    write_text(folder / "case.foam", "")
    if (stream := Stream.of(scene)) is not None:
        stream = stream.held() if name == LEAD else stream
        times = Steps.of(interval.begin, interval.end, scene.numerics.time_step).times
        write_current(stream, times, mesh, points, folder)
        if name == LEAD and not stream.current.channel:  # whose parabola runs in from the inflow
            corners = planform["triangles"].values, planform["quads"].values
            start_stream(stream, cell_centres(nodes, *corners)[mesh.cell_column, 1], folder)
    if name == LEAD:
        for unused in ("functions", "obstacles"):
            write_text(folder / "system" / unused, "// nothing is sampled\n")
    elif scene.coupled:
        add_gate(folder)

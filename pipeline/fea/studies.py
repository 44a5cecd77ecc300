"""`python -m pipeline.fea.studies`: the paper's studies of θ, W and materials → docs/fea/ (tables and figures)."""

from __future__ import annotations

import argparse
from pathlib import Path

from pipeline.fea.calculix import release
from pipeline.fea.engines import solid
from pipeline.fea.figures import draw
from pipeline.fea.settings import Actuator, Fea, Material, Materials, SolidMesh
from pipeline.fea.states import read
from pipeline.fea.sweep import Bends, sweep
from pipeline.fea.tables import write_results, write_table
from pipeline.scene import load_scene
from pipeline.stage import guarded

WEDGES_DEG = (0, 5, 10, 15, 20, 25, 30)
WIDTHS_MM = (12, 20, 28)
# Dragon Skin 10 as the paper gives it; its bulk modulus is taken as that of Dragon Skin 30
DRAGON_SKIN_10 = Material(
    name="Dragon Skin 10", law="yeoh", parameters={"C10": 36e3, "C20": 258.0, "C30": 0.56}, bulk=16.67e6
)


def cases(actuator: Actuator, fea: Fea) -> dict[str, tuple[Actuator, Fea]]:
    """Every actuator of the paper's Figs 3, 7 and 8, by name."""
    result = {f"theta_{w}": actuator.model_copy(update={"wedge_deg": float(w)}) for w in WEDGES_DEG}
    result |= {f"width_{w}": actuator.model_copy(update={"width": w * 1e-3}) for w in WIDTHS_MM}
    ds30 = actuator.materials.upper
    for name, upper, lower in (
        ("u10_l30", DRAGON_SKIN_10, ds30),
        ("u30_l30", ds30, ds30),
        ("u30_l10", ds30, DRAGON_SKIN_10),
    ):
        result[name] = actuator.model_copy(update={"materials": Materials(upper=upper, lower=lower)})
    return {name: (one, fea) for name, one in result.items()}


def against_calculix(actuator: Actuator, fea: Fea, work: Path) -> dict[str, Bends]:
    """The default finger in 3-D at 10, 20 and 30 kPa, meshed as finely as the unit cell."""
    m = fea.mesh
    same = SolidMesh(**m.model_dump() | {"cavity": 2 * m.cavity, "gap": 2 * m.gap})
    asked = {
        "solid_mesh": same,
        "first_pressure_kpa": 10.0,
        "last_pressure_kpa": 30.0,
        "pressure_step_kpa": 10.0,
    }
    states = solid(work, actuator, fea.model_copy(update=asked))
    return {f"CalculiX {release()}": Bends(states.pressure, states.radius, states.fit_residual)}


def run(case: Path, docs: Path, work: Path, processes: int, calculix: bool) -> None:
    """Solve what is missing, write tables, draw figures."""
    scene = load_scene(case)
    actuator, fea = Actuator(**scene.actuator), Fea(**scene.fea)
    coarse = fea.model_copy(
        update={"first_pressure_kpa": -40.0, "last_pressure_kpa": 40.0, "pressure_step_kpa": 5.0}
    )
    bends = sweep(cases(actuator, coarse), work, processes)
    write_table(docs / "studies.csv", bends)
    if calculix:
        write_table(docs / "calculix.csv", against_calculix(actuator, fea, work), last="fit_residual_mm")
    states = read(case / "kinematics" / "states.h5")
    write_results(docs / "results.md", bends, states, docs / "calculix.csv")
    draw(docs, bends, states)
    print(f"tables and figures → {docs}")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m pipeline.fea.studies", description=__doc__)
    parser.add_argument("case", type=Path, nargs="?", default=Path("cases/single_finger"))
    parser.add_argument("--docs", type=Path, default=Path("docs/fea"), help="where tables and figures go")
    parser.add_argument(
        "--work", type=Path, default=None, help="finished runs (default: <case>/out/fea_studies)"
    )
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument(
        "--calculix", action="store_true", help="run the comparison in 3-D again (several minutes)"
    )
    given = parser.parse_args()
    work = given.work or given.case / "out" / "fea_studies"
    guarded("fea.studies", lambda: run(given.case, given.docs, work, given.processes, given.calculix))


if __name__ == "__main__":
    main()

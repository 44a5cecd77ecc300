"""softfinger identify: a scene whose rubber, damping and clock are those of a filmed finger."""

import json
import os
import re
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from piv.files.errors import StageError
from softfinger.options import SceneFolder, Switch

_TEXT = """\
# Written by softfinger identify from {films}; bands hold 95 % (identify.json has all).
# Its bending states, kinematics/states.h5, are those of {parent} for a rubber
# {stiff} times as stiff, and against loads {loads} times that.
extends = "{parent}"
title = "{title}, twin"

[structure]
loss_factor = {loss}
"""
_VALUE = "{value:.4g} ({band[0]:.4g} to {band[1]:.4g})"


def identify(
    scene: SceneFolder,
    *,
    film: Annotated[list[Path], Parameter(help="Video or folder of pictures; once for each.")],
    pressure: Annotated[list[Path], Parameter(help="Table t,p (s, Pa): one for each film.")],
    scale: Annotated[float, Parameter(help="Size of a pixel where the finger is, in mm.")],
    root: Annotated[str, Parameter(help="Middle of the root in the picture: 320,80 (px, y down).")],
    hold_out: Annotated[Path | None, Parameter(help="A film that is foretold, not fitted.")] = None,
    rate: Annotated[float | None, Parameter(help="Pictures a second; absent: the file's.")] = None,
    air: Switch = False,
    output: Annotated[Path | None, Parameter(help="The new scene's folder.")] = None,
) -> Path:
    """Fit rubber and damping of a scene's finger to films and their pressures.

    Writes a scene with the fitted numbers, identify.json and identify.html. The last pressure is
    that of the film that is held out. Films begin on the clock of their pressure, within 40 ms.
    """
    from pipeline.fea.up_to_date import check_states
    from pipeline.formats.bending_states import write
    from pipeline.scene.read_toml import OWN_STATES
    from pipeline.scene.scene import load_scene
    from piv.files.atomic import write_text
    from piv.formats.user_tables import read_history
    from postprocess.lab.pose import Pose
    from softfinger.twin.film import read_film
    from softfinger.twin.identify import identified, judged, record
    from softfinger.twin.model import LOADS, LOSS, STIFF, Stroke, Twin, scaled
    from softfinger.twin.page import write_page

    films = [*film, *([hold_out] if hold_out else [])]
    if len(films) != len(pressure):
        raise StageError(f"{len(films)} films and {len(pressure)} --pressure: give one for each")
    place = re.fullmatch(r"\s*([\d.]+)\s*,\s*([\d.]+)\s*", root)
    if not place:
        raise StageError(f"--root {root}: give column and row of the root's middle, as 320,80")
    loaded = load_scene(scene)
    check_states(loaded)
    target = output or scene.with_name(f"{scene.name}_twin")
    if (target / "scene.toml").exists():
        raise StageError(f"{target / 'scene.toml'}: exists already; give another --output")
    rows = _rows_of(films[0])
    at = float(place[1]), rows - 1 - float(place[2])
    twin = Twin(loaded, Pose(scale, 0.0, loaded.finger.root, at), air)
    strokes = []
    for one, log in zip(films, pressure, strict=True):
        times, _ = read_history(log, "pressure", least=2)
        rest = twin.at_rest()
        strokes.append(
            Stroke(read_film(one, rate, twin.pose, rest, float(times[-1] - times[0])), log)
        )
    found = identified(twin, strokes[: len(film)])
    fitted = [judged(twin, found, stroke) for stroke in strokes[: len(film)]]
    held = judged(twin, found, strokes[-1]) if hold_out else None
    values = found.values()
    told = {row["name"]: _VALUE.format(**row) for row in found.table()}
    text = _TEXT.format(
        films=", ".join(path.name for path in film),
        parent=os.path.relpath(scene, target),
        stiff=told[STIFF],
        loads=told[LOADS],
        title=loaded.title,
        loss=told[LOSS].replace("(", "# ").rstrip(")"),
    )
    write(target / OWN_STATES, scaled(twin.states, values[STIFF], values[LOADS]))
    write_text(target / "scene.toml", text)
    about = json.dumps(record(found, fitted, held), indent=1)
    write_text(target / "identify.json", about + "\n")
    write_page(target / "identify.html", twin, found, fitted, held)
    for row in found.table():
        low, high = row["band"]
        doubt = "" if row["told"] else " (not told by the films)"
        print(f"{row['name']:32s} {row['value']:9.4g}  {low:.4g} to {high:.4g}{doubt}")
    print(f"scene: {target}\nreport: {(target / 'identify.html').resolve()}")
    return target


def _rows_of(film: Path) -> int:
    """Rows of a film's pictures."""
    from piv.images.open_recording import open_recording

    try:
        return open_recording(film, colour="luma").shape[0]
    except (ValueError, FileNotFoundError) as error:
        raise StageError(str(error)) from error

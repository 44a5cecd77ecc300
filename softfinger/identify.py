"""softfinger identify: a scene whose rubber, damping and clock are those of a filmed finger."""

import json
import math
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from piv.files.errors import StageError
from softfinger.options import SceneFolder, Switch

if TYPE_CHECKING:
    from pipeline.scene.scene import Scene
    from softfinger.twin.fit import Fit
    from softfinger.twin.model import Twin

_TEXT = """\
# Written by softfinger identify from {films}; bands of 95 % (identify.json has all).
# Its bending states, kinematics/states.h5, are those of {parent} for a rubber
# {stiff} times as stiff, and against loads {loads} times that.
extends = {extends}
title = {title}

[structure]
loss_factor = {loss}
"""
CONFIRMED = (
    "coupled run ({level}): its tip is within {film:.1%} of the length of the film's, and within"
    " {chain:.1%} of that in modelled water (RMS)"
)
_VALUE = "{value:.4g} ({band[0]:.4g} to {band[1]:.4g})"


def _pixel(place: str) -> tuple[float, float]:
    """Return column and row in px of `place`, as 320,80; raises StageError for other text."""
    found = re.fullmatch(r"\s*(\d+\.?\d*)\s*,\s*(\d+\.?\d*)\s*", place)
    if not found:
        raise StageError(f"--root {place}: give column and row of the root's middle, as 320,80")
    return float(found[1]), float(found[2])


def _different_names(films: list[Path]) -> None:
    """Raise StageError where two of `films` have one name, by which results are kept."""
    names = [path.name for path in films]
    if twice := next((name for name in names if names.count(name) > 1), ""):
        raise StageError(f"{twice}: two films have this name; rename one, or give another")


def _modelled(scene: "Scene", path: Path, air: bool) -> None:
    """Raise StageError for a `scene`, read from `path`, that the film's model cannot describe."""
    if scene.motion.source not in ("fea", "structure") or not scene.motion.states:
        raise StageError(
            f"{path}: motion.source = {scene.motion.source!r} uses no bending states, which are"
            " fitted; give a scene with motion.source = 'fea' or 'structure'"
        )
    if scene.current is not None and not air:
        raise StageError(
            f"{path}: the water that is fitted rests, but [current] moves it; give a film in still"
            " water and a scene without [current], or a film in air with --air"
        )


def _confirmable(scene: Path, level: str, air: bool) -> None:
    """Raise StageError for what the runs of --confirm would refuse after the fit."""
    from pipeline.openfoam.environment import check_openfoam
    from pipeline.scene.scene import load_scene

    if level and air:
        raise StageError("--confirm: a film in air has no water; leave out --confirm or --air")
    if level:
        load_scene(scene, level)
        check_openfoam(1)


def _begin(target: Path, words: dict[str, Any]) -> None:
    """Keep what a fit in `target` was asked for; StageError for a folder with another scene.

    The same fit goes on where it was interrupted.
    """
    from piv.files.atomic import write_text
    from piv.files.regular import read_regular

    kept = target / "out" / "identify_begun.json"
    text = json.dumps({name: str(value) for name, value in words.items()}, indent=1) + "\n"
    if (target / "scene.toml").exists():
        begun = kept.exists() and read_regular(kept).decode() == text
        if not begun or (target / "identify.json").exists():
            raise StageError(f"{target / 'scene.toml'}: exists already; give another --output")
    write_text(kept, text)


def identify(
    scene: SceneFolder,
    *,
    film: Annotated[list[Path], Parameter(help="Video or folder of pictures; once for each.")],
    pressure: Annotated[list[Path], Parameter(help="Table t,p (s, Pa): one for each film.")],
    scale: Annotated[float, Parameter(help="Size of a pixel where the finger is, in mm.")],
    root: Annotated[str, Parameter(help="Middle of the root in the picture: 320,80 (px, y down).")],
    hold_out: Annotated[
        Path | None, Parameter(help="A film that is predicted, not fitted.")
    ] = None,
    rate: Annotated[float | None, Parameter(help="Pictures a second; absent: the file's.")] = None,
    air: Switch = False,
    confirm: Annotated[
        str,
        Parameter(help="Level of five coupled runs, for the water's share and the flow: draft."),
    ] = "",
    output: Annotated[Path | None, Parameter(help="The new scene's folder.")] = None,
) -> Path:
    """Fit rubber and damping of a scene's finger to films and their pressures.

    Writes a scene with the fitted numbers, identify.json and identify.html. The last pressure is
    that of the film that is held out. A film begins at t = 0 of its pressure, within 40 ms. After
    an interruption the same command goes on: coupled runs that have ended are kept.
    """
    from pipeline.fea.up_to_date import check_states
    from pipeline.scene.scene import load_scene
    from piv.files.atomic import write_text
    from postprocess.lab.pose import Pose
    from softfinger.twin.advice import FOLDER, advised
    from softfinger.twin.confirm import compared, corrected, coupled, water
    from softfinger.twin.film import shape_of
    from softfinger.twin.flow import LAST, flow_bands
    from softfinger.twin.identify import identified, judged, record
    from softfinger.twin.model import Twin, read_stroke
    from softfinger.twin.page import write_page

    films = [*film, *([hold_out] if hold_out else [])]
    if len(films) != len(pressure):
        raise StageError(f"{len(films)} films and {len(pressure)} --pressure: give one for each")
    _different_names(films)
    if not 0 < scale < math.inf:
        raise StageError(f"--scale {scale:g}: give mm per pixel, as 0.25")
    column, y_down = _pixel(root)
    loaded = load_scene(scene)
    _modelled(loaded, scene / "scene.toml", air)
    check_states(loaded)
    _confirmable(scene, confirm, air)
    target = output or scene.with_name(f"{scene.name}_twin")
    shapes = [shape_of(path) for path in films]
    if len(set(shapes)) > 1:
        raise StageError(f"films of different sizes, {shapes}; give films of one camera that rests")
    at = column, shapes[0][0] - 1 - y_down
    twin = Twin(loaded, Pose(scale, 0.0, loaded.finger.root, at), shapes[0], air)
    strokes = [read_stroke(twin, *each, rate) for each in zip(films, pressure, strict=True)]
    for one in strokes:
        if one.film.unused:
            print(f"{one.film.name}: {one.film.unused} pictures after its pressure are not used")
    asked = {"scene": scene.resolve(), "films": [path.resolve() for path in films]}
    asked |= {"pressures": [path.resolve() for path in pressure], "scale": scale, "root": root}
    _begin(target, asked | {"rate": rate, "air": air, "confirm": confirm})
    to_fit = strokes[: len(film)]
    found = identified(twin, to_fit)
    _write_scene(target, scene, twin, found, film)
    more: dict[str, Any] = {}
    if confirm:
        _, run = coupled(twin, target, confirm, to_fit[0], "corrects")
        of_water = water(twin, found.values(), to_fit[0], run)
        twin = replace(twin, water=corrected(of_water))
        found = identified(twin, to_fit, found)
        _write_scene(target, scene, twin, found, film)
        base, run = coupled(twin, target, confirm, strokes[-1], "confirms", last=LAST)
        flow = flow_bands(twin, found, target, confirm, strokes[-1], base)
    fitted = [judged(twin, found, stroke) for stroke in to_fit]
    held = judged(twin, found, strokes[-1]) if hold_out else None
    if confirm:
        more["coupled"] = {"level": confirm, "water": of_water.table(), "flow": flow}
        more["coupled"] |= compared(twin, held or fitted[-1], run)
    more["next"] = advised(twin, found, to_fit[0], target / FOLDER)
    about = json.dumps(record(found, fitted, held, more), indent=1)
    write_text(target / "identify.json", about + "\n")
    write_page(target / "identify.html", twin, found, fitted, held, more)
    _print_result(found, more)
    print(f"scene: {target}\nreport: {(target / 'identify.html').resolve()}")
    return target


def _print_result(found: "Fit", more: dict[str, Any]) -> None:
    """Print what was found, as the page states it."""
    from softfinger.twin.advice import advice
    from softfinger.twin.identify import warnings

    for row in found.table():
        low, high = row["band"]
        doubt = "" if row["told"] else " (not determined by the films)"
        print(f"{row['name']:32s} {row['value']:9.4g}  {low:.4g} to {high:.4g}{doubt}")
    for warning in warnings(found):
        print(f"warning: {warning}")
    print(f"outlines differ by {found.rms:.2f} px (RMS)")
    if "coupled" in more:
        print(CONFIRMED.format(**more["coupled"]))
        for row in more["coupled"]["flow"]:
            print("{name}: {value:.3g}, {band[0]:.3g} to {band[1]:.3g}".format(**row))
    print(f"next: {advice(found, more['next'])}")


def _write_scene(target: Path, scene: Path, twin: "Twin", found: "Fit", film: list[Path]) -> None:
    """Write a scene with the fitted numbers, and its bending states."""
    from pipeline.formats.bending_states import write
    from pipeline.scene.read_toml import OWN_STATES
    from piv.files.atomic import write_text
    from softfinger.twin.model import LOADS, LOSS, STIFF, scaled

    fitted_to = {row["name"]: _VALUE.format(**row) for row in found.table()}
    parent, values = os.path.relpath(scene, target), found.values()
    text = _TEXT.format(
        films=", ".join(path.name for path in film),
        parent=parent,
        extends=json.dumps(parent, ensure_ascii=False),
        stiff=fitted_to[STIFF],
        loads=fitted_to[LOADS],
        title=json.dumps(f"{twin.scene.title}, twin", ensure_ascii=False),
        loss=fitted_to[LOSS].replace("(", "# ").rstrip(")"),
    )
    write(target / OWN_STATES, scaled(twin.states, values[STIFF], values[LOADS]))
    write_text(target / "scene.toml", text)

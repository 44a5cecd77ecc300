"""What is modelled and what is not, each with the number that justifies it."""

import os
from typing import Any

from pipeline.scene.current import Stream, frontal_share, lead_steps
from pipeline.scene.obstacle import Obstacle
from pipeline.scene.pinch import Pinch
from pipeline.scene.read_toml import FILE_KEYS
from pipeline.scene.scene import Scene
from pipeline.scene.sections import SMOOTHING, Motion

_GRAVITY = 9.81  # m/s²
_WAVES = 0.5  # Froude number from which waves are to be expected
_PARTS = {
    "2d": "A plane without depth is computed: no water passes round the {name}'s sides, so its"
    " forces and vortices are too strong.",
    "half": "Half of the tank is computed; the laser sheet is its plane of symmetry, so no water"
    " crosses the sheet.",
    "quarter": "A quarter of the tank is computed; the laser sheet and the plane between the"
    " fingers are its planes of symmetry, so no water crosses them and the fingers' vortices are"
    " exact mirror images.",
    "full": "The whole tank is computed.",
}


def statements(scene: Scene, speed: float, tip_height: float) -> list[tuple[str, str]]:
    """Pairs (what, why) for the report.

    `speed`: peak tip speed (m/s); `tip_height`: highest position of the tip (m).
    """
    name = _name(scene)
    reynolds = speed * _width(scene) / scene.fluid.kinematic_viscosity
    turbulence, kind = scene.fluid.turbulence, scene.model.kind
    flow = (
        "The flow is laminar in the equations: no turbulence model acts."
        if turbulence == "laminar"
        else f"Turbulence below the mesh size is modelled by {turbulence}."
    )
    model = _PARTS[kind].format(name=name)
    if scene.pinch and kind == "2d":
        model += " The plane between the fingers is a plane of symmetry."
    support = (
        f"A block of {' × '.join(f'{1e3 * side:.0f}' for side in scene.support.size)} mm"
        " above the roots."
        if scene.support
        else f"The hardware that holds the {name} is not in the water of the simulation."
    )
    motion = (
        "The body is rigid and its motion is prescribed."
        if scene.body
        else "Pressure and water make the finger's motion together: in each time step the finger"
        " bends under the loads of the water (docs/coupling.md)." + _share(scene.load_share)
        if scene.coupled
        else "The finger's motion is prescribed; the water does not bend it. The head of the page"
        " states where water would have it."
    )
    motion += _pressure(scene.motion)
    surface = (
        f"A rigid lid on which water slips: no waves. At {speed:.2f} m/s the {name} could raise"
        f" the surface by at most {speed**2 / (2 * _GRAVITY) * 1e3:.1f} mm; it stays"
        f" {_depth(scene, tip_height) * 1e3:.0f} mm below it (Froude number by that depth"
        f" {_froude(scene, speed, tip_height):.2f})."
    )
    piv = (
        "The recording is synthetic: particles are moved by the simulated flow and photographed by"
        " a virtual camera. It shows the error of the measurement, not yet that of the simulation;"
        " that needs a laboratory's recording."
    )
    return [
        ("Motion", motion),
        *([("Actuator", _actuator(scene))] if scene.actuator and not scene.body else []),
        *([("Current", _current(stream, scene))] if (stream := Stream.of(scene)) else []),
        ("Water surface", surface),
        ("Turbulence", f"{flow} Reynolds number by {name} width {reynolds:,.0f}."),
        ("Model", model),
        ("Support", support),
        *([("Obstacles", _obstacles(scene.obstacle))] if scene.obstacle else []),
        *([("Contact", _contact(scene.pinch))] if scene.pinch else []),
        *([("PIV", piv)] if scene.filmed else []),
        ("Files", f"The run reads {', '.join(_files(scene))}."),
    ]


def _files(scene: Scene) -> list[str]:
    """What a run reads of the scene's folder and of others, as paths from the scene's folder."""
    parents = [os.path.relpath(folder, scene.folder) for folder in scene.parents]
    named = [getattr(scene.motion, key) for key in sorted(FILE_KEYS)]
    named.append(scene.current.table if scene.current else None)
    results = scene.fea.get("results", {})
    named += [results.get(key) for key in ("file", "displacements")]
    return ["scene.toml", *(f"{name}/scene.toml" for name in parents), *filter(None, named)]


def _current(stream: Stream, scene: Scene) -> str:
    """How water runs through the tank, how it began, and what the walls do to it."""
    current, step = stream.current, scene.numerics.time_step
    peak, lead = stream.peak(scene.motion.end_time, step), lead_steps(scene) * step
    begun = (
        f"runs from the start, and has run {lead:.3g} s past the resting {_name(scene)}"
        if lead
        else f"begins from rest{f' over {current.ramp:g} s' if current.ramp else ''}; while it"
        " is accelerated, the mesh disturbs it by a few per cent"
    )
    time = (
        f", as {current.table} says"
        if current.table
        else f" and swings by {current.amplitude:g} m/s at {current.frequency:g} Hz"
        if current.amplitude
        else ""
    )
    profile = (
        f"; the inflow has a boundary layer of {1e3 * current.thickness:g} mm at the bottom"
        if current.thickness
        else "; the inflow is uniform"
    )
    walls = "sticks to" if current.walls == "no-slip" else "slips along"
    blocked = frontal_share(scene)
    return (
        f"Water runs through the tank's ends towards {current.direction} at up to"
        f" {peak:.3g} m/s{time}. It {begun}{profile}. At the outflow the pressure is 0 and the"
        " velocity has no gradient; what enters there comes straight. Water"
        f" {walls} the tank's bottom and sides. The straight {_name(scene)} takes"
        f" {100 * blocked:.1f} % of the tank's cross-section, beside which water runs up to"
        f" {100 * blocked / (1 - blocked):.1f} % faster than in open water."
    )


def _name(scene: Scene) -> str:
    return "body" if scene.body else "finger"


def _actuator(scene: Scene) -> str:
    """The actuator, its materials, the states of its bending and the pressure that drives it."""
    actuator, motion = scene.actuator, scene.motion
    layers = actuator.get("materials") or {}
    named = actuator.get("material") or {
        layer: part.get("material") or part.get("name") or part.get("law", "not named")
        for layer, part in layers.items()
    }
    if isinstance(named, dict):
        named = ", ".join(f"{layer} layer of {name}" for layer, name in named.items())
    length, width = 1e3 * scene.finger.length, 1e3 * scene.finger.width
    size = f"{actuator.get('chambers', 'imported')} chambers, {length:g} × {width:g} mm; {named}"
    strokes = ", ".join(
        f"to {s.pressure_kpa:g} kPa in {s.duration:g} s from {s.start:g} s" for s in motion.strokes
    )
    states = f"; bending: {motion.states}" if motion.states else ""
    return f"{size}{states}; pressure: {motion.pressure_csv or strokes}."


def _share(share: float) -> str:
    """What a plane flow's loads are multiplied with; nothing in space."""
    if share == 1:
        return ""
    return (
        f" The loads of the plane flow count {share:.2f} times, because in space water also goes"
        " around the width of the finger (slender-body theory)."
    )


def _pressure(motion: Motion) -> str:
    """How a measured pressure was smoothed; nothing of strokes."""
    if not motion.pressure_csv:
        return ""
    span = SMOOTHING if motion.smoothing is None else motion.smoothing
    if not span:
        return f" The pressure is a spline through {motion.pressure_csv}."
    return (
        f" The pressure of {motion.pressure_csv} is averaged over the {1e3 * span:g} ms before"
        f" each instant, so that the finger starts from rest; it lags by {500 * span:g} ms"
        " (motion.smoothing)."
    )


def purpose(scene: Scene, trial: str, speed: float, tip_height: float) -> tuple[str, str]:
    """What a run can be used for, and what not; `trial`: why it is only for trying out."""
    name = _name(scene)
    if trial:
        return (
            "checking that every stage works, and trying out settings.",
            f"any number of the {name}: its flow in space differs from this one.",
        )
    avoid = ["peak vorticity and wall friction, which a finer grid still changes"]
    if not scene.body and not scene.coupled:
        avoid.append("how fast a free finger bends: the motion is prescribed (COUPLED=1 frees it)")
    if _froude(scene, speed, tip_height) > _WAVES:
        avoid.append("anything near the surface: the simulation has no waves")
    return (
        "where the vortices are, which way they turn and go, how strong they are, and the force,"
        " within the errors below; for planning a recording.",
        "; ".join(avoid) + ".",
    )


def flow_numbers(scene: Scene, speed: float, way: float, run: dict[str, Any]) -> str:
    """The numbers that set the flow; `speed`: peak of the tip, m/s; `way`: the tip's path, m."""
    strokes = scene.motion.strokes
    width, viscosity = _width(scene), scene.fluid.kinematic_viscosity
    current = ""
    if stream := Stream.of(scene):
        peak = stream.peak(scene.motion.end_time, scene.numerics.time_step)
        current = (
            f" · current of {peak:.3g} m/s: Reynolds number {peak * width / viscosity:,.0f} by"
            f" width, {peak / speed:.2g} of the peak tip speed, past a width in"
            f" {width / peak:.2g} s"
        )
    time = sum(stroke.duration for stroke in strokes) or scene.motion.end_time
    ratio = (
        f"formation number {way / width:.2g} (way of the tip over width)"
        if len(strokes) < 2
        else f"Keulegan–Carpenter number {speed * time / width:.2g}"
    )
    return (
        f"Reynolds number {speed * width / viscosity:,.0f} by width and peak tip speed"
        f" {speed:.3f} m/s · {ratio} · Strouhal number {width / (speed * time):.2g} (width over"
        f" speed and {time:g} s of motion){current} · Courant number at most"
        f" {run['courant_max']:.1f}"
    )


def _width(scene: Scene) -> float:
    return scene.body.size if scene.body else scene.finger.width


def _froude(scene: Scene, speed: float, tip_height: float) -> float:
    """By the least depth of the finger below the surface."""
    return float(speed / (_GRAVITY * _depth(scene, tip_height)) ** 0.5)


def _depth(scene: Scene, tip_height: float) -> float:
    return scene.tank.water_depth - max(tip_height, scene.finger.root[1])


def _obstacles(obstacles: tuple[Obstacle, ...]) -> str:
    """Which fixed bodies stand beside the finger, and what they are to the water."""
    shapes = ", ".join(f"{k} a {thing.shape}" for k, thing in enumerate(obstacles, 1))
    return (
        f"Fixed bodies stand in the water ({shapes}). They are rigid and water sticks to them; the"
        " mesh has no layers of thin cells there, so friction on them is coarse."
    )


def _contact(pinch: Pinch) -> str:
    """What stands for the contact of two fingers."""
    between, thing = "the plane between the fingers", pinch.object
    if thing:
        between = f"a fixed {thing.shape} of {1e3 * thing.diameter:g} mm"
    return (
        f"A mesh cannot close: the tips are slowed down over {1e3 * pinch.slowing_distance:g} mm"
        f" and stop {1e3 * pinch.residual_gap:g} mm before {between}. Real tips touch, and give"
        " way."
    )

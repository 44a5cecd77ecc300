"""Tables of a scene with two fingers, [pinch], [pinch.object] and [support], and their checks."""

from typing import Annotated, Literal

from pydantic import Field

from pipeline.scene.section import Positive, Section
from pipeline.scene.sections import Finger, Tank


class _Object(Section):
    """A fixed body between the tips, centred on x = 0 and on the sheet; lengths in m.

    A cylinder lies along z and is as long as the finger is wide.
    """

    shape: Literal["cylinder", "sphere"] = "cylinder"
    """Of the body between the tips"""
    diameter: Positive
    """Of it [m]"""
    centre_height: Positive
    """y of its centre in the tank frame [m]"""


class Pinch(Section):
    """Two fingers, mirror images in the plane x = 0; lengths in m.

    Contact (pipeline/kinematics/contact.py): the closing law slows the tips down over
    `slowing_distance` and stops them at `residual_gap`.
    """

    half_distance: Positive
    """From the plane between the fingers to the middle of each root [m]"""
    residual_gap: Annotated[Positive, Field(ge=2e-5)] = 0.0005
    """Where the tips stop before the plane or the object [m]"""
    slowing_distance: Positive = 0.003
    """Part of the gap over which the fingers are slowed down [m]"""
    closing_law: Literal["ramp", "exponential"] = "ramp"
    """How the speed falls over it"""
    object: _Object | None = None
    """A fixed body between the tips"""


class Support(Section):
    """A fixed block above the roots, centred on x = 0, z = 0; lengths in m."""

    size: tuple[Positive, Positive, Positive]
    """X, height, z of a fixed block above the roots [m]"""
    bottom: Positive
    """Height of its lower face [m]"""


def check_pinch(pinch: Pinch, finger: Finger, tank: Tank, start_pressure_kpa: float) -> None:
    """ValueError where two such fingers cannot hang in the tank."""
    half, thick = pinch.half_distance, finger.thickness
    opening, walls = half - 0.5 * thick, 0.5 * tank.size[0] - 0.5 * thick
    least = pinch.residual_gap + pinch.slowing_distance
    if finger.root[0] != 0:
        raise ValueError(
            f"finger.root[0] = {finger.root[0]:g} m must be 0 beside [pinch], which places the"
            " fingers at -half_distance and +half_distance; give pinch.half_distance only"
        )
    if finger.ventral != "+x":
        raise ValueError(
            "finger.ventral must be '+x' beside [pinch]: the fingers close towards each other"
        )
    if half >= walls:
        raise ValueError(
            f"pinch.half_distance = {half:g} m puts the fingers into the walls of the tank; give"
            f" less than {walls:g}"
        )
    if opening <= least:
        raise ValueError(
            f"pinch.half_distance = {half:g} m leaves {opening:g} m between a finger of {thick:g} m"
            f" thickness and the plane, not more than residual_gap + slowing_distance = {least:g}"
            " m; raise half_distance"
        )
    if pinch.object is not None:
        _check_object(pinch.object, opening - pinch.residual_gap, finger, tank, start_pressure_kpa)


def _check_object(
    thing: _Object, free: float, finger: Finger, tank: Tank, start_pressure_kpa: float
) -> None:
    radius = 0.5 * thing.diameter
    if not radius < thing.centre_height < tank.water_depth - radius:
        raise ValueError(
            f"pinch.object.centre_height = {thing.centre_height:g} m puts the object out of the"
            f" water; give {radius:g} to {tank.water_depth - radius:g}"
        )
    if thing.shape == "sphere" and thing.diameter >= tank.size[2]:
        raise ValueError(
            f"pinch.object.diameter = {thing.diameter:g} m does not fit between the tank's walls"
        )
    if (
        start_pressure_kpa >= 0
        and radius >= free
        and thing.centre_height + radius > finger.root[1] - finger.length
    ):
        raise ValueError(
            f"pinch.object.diameter = {thing.diameter:g} m is wider than the opening of the"
            f" straight fingers, {2 * free:g} m; raise half_distance, or start opened by a negative"
            " motion.start_pressure_kpa"
        )


def check_support(support: Support, finger: Finger, tank: Tank) -> None:
    """ValueError where the block does not hang above the roots and in the water."""
    if support.bottom < finger.root[1]:
        raise ValueError(
            f"support.bottom = {support.bottom:g} m lies below the roots at {finger.root[1]:g} m;"
            " raise it"
        )
    if support.bottom + support.size[1] >= tank.water_depth:
        raise ValueError(
            f"support.size[1] = {support.size[1]:g} m reaches the surface at {tank.water_depth:g}"
            f" m; give less than {tank.water_depth - support.bottom:g}"
        )
    if support.size[0] >= tank.size[0] or support.size[2] >= tank.size[2]:
        raise ValueError(
            f"support.size = {list(support.size)} m does not fit into the tank; make it smaller"
        )

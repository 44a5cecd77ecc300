"""What is modelled and what is not, each with the number that justifies it."""

from __future__ import annotations

from typing import Any

GRAVITY = 9.81  # m/s²


def statements(scene: dict[str, Any], speed: float, tip_height: float) -> list[tuple[str, str]]:
    """Pairs (what, why) for the report; speed is the peak tip speed (m/s), tip_height the highest position of the tip (m).

    `scene` holds the scene's sections tank, finger (or body), fluid and model.
    """
    fluid, finger, tank, body = scene["fluid"], scene["finger"], scene["tank"], scene.get("body")
    name, width = (
        ("body", body["diameter"] or body["chord"]) if body else ("finger", finger["width"])
    )
    reynolds = (
        f"Reynolds number by {name} width {speed * width / fluid['kinematic_viscosity']:,.0f}."
    )
    depth = tank["water_depth"] - max(tip_height, finger["root"][1])
    froude = speed / (GRAVITY * depth) ** 0.5
    turbulence, kind = fluid["turbulence"], scene["model"]["kind"]
    flow = (
        f"The flow is laminar in the equations: no turbulence model acts. {reynolds}"
        if turbulence == "laminar"
        else f"Turbulence below the mesh size is modelled by {turbulence}. {reynolds}"
    )
    parts = {
        "2d": f"A plane without depth is computed: no water passes round the {name}'s sides, so its forces and vortices are too strong.",
        "half": "Half of the tank is computed; the laser sheet is its plane of symmetry, so no water crosses the sheet.",
        "quarter": "A quarter of the tank is computed; the laser sheet and the plane between the fingers are its planes of symmetry, so no water crosses them and the fingers' vortices are exact mirror images.",
        "full": "The whole tank is computed.",
    }
    if scene.get("pinch") and kind == "2d":
        parts["2d"] += " The plane between the fingers is a plane of symmetry."
    held = (
        f"A block of {' × '.join(f'{1e3 * side:.0f}' for side in scene['support']['size'])} mm above the roots."
        if scene.get("support")
        else f"The hardware that holds the {name} is not in the water of the simulation."
    )
    return [
        (
            "Motion",
            "The body is rigid and its motion is prescribed."
            if body
            else "The finger's motion is prescribed; the water does not bend it. What the loads on it would bend is said at the head of the page.",
        ),
        (
            "Water surface",
            f"A rigid lid on which water slips: no waves. At {speed:.2f} m/s the {name} could raise the surface by at most"
            f" {speed**2 / (2 * GRAVITY) * 1e3:.1f} mm; it stays {depth * 1e3:.0f} mm below it (Froude number by that depth {froude:.2f}).",
        ),
        ("Turbulence", flow),
        ("Model", parts.get(kind, f"Model: {kind}.")),
        ("Support", held),
        *_contact(scene.get("pinch")),
        (
            "PIV",
            "The recording is synthetic: particles are moved by the simulated flow and photographed by a virtual camera. It shows the"
            " error of the measurement, not yet that of the simulation; that needs a laboratory's recording.",
        ),
    ]


def _contact(pinch: dict[str, Any] | None) -> list[tuple[str, str]]:
    """What stands for the contact of two fingers."""
    if not pinch:
        return []
    thing = pinch.get("object")
    between = (
        f"a fixed {thing['shape']} of {1e3 * thing['diameter']:g} mm"
        if thing
        else "the plane between the fingers"
    )
    return [
        (
            "Contact",
            f"A mesh cannot close: the tips are slowed down over {1e3 * pinch['slowing_distance']:g} mm and stop"
            f" {1e3 * pinch['residual_gap']:g} mm before {between}. Real tips touch, and give way.",
        )
    ]

"""Masks and a region that were drawn, as the file that `correlate --mask` reads."""

import json
from pathlib import Path

from piv.files.atomic import write_text

Polygon = list[list[float]]  # corners (x, y)


def write_regions(
    path: Path,
    unit: str,
    kept: dict[int, list[Polygon]],
    roi: tuple[float, float, float, float] | None,
) -> str:
    """Write the polygons of each frame and the region x0, y0, x1, y1; returns a line about it.

    One frame: bodies that stand still. Several: bodies that move, each with as many corners at
    every frame. ValueError where they do not fit, or where nothing is drawn.
    """
    frames = sorted(kept)
    numbers = {len(kept[f]) for f in frames}
    if len(numbers) > 1:
        raise ValueError("draw as many polygons at each of the frames")
    bodies = []
    for k in range(numbers.pop() if numbers else 0):
        corners = [kept[f][k] for f in frames]
        if any(len(c) < 3 for c in corners):
            raise ValueError("a polygon needs at least 3 corners")
        if len({len(c) for c in corners}) > 1:
            raise ValueError(
                f"polygon {k + 1} has not the same number of corners at each frame; move its "
                "corners instead"
            )
        bodies.append(
            {"frames": frames, "corners": corners} if len(frames) > 1 else {"corners": corners[0]}
        )
    if not bodies and roi is None:
        raise ValueError("nothing is drawn yet")
    content = {"format": "mask-polygons", "format_version": 1, "unit": unit, "bodies": bodies}
    write_text(path, json.dumps(content | ({"roi": list(roi)} if roi else {}), indent=1) + "\n")
    moving = f" at {len(frames)} frames" if len(frames) > 1 else ""
    found = f"{len(bodies)} polygon{'s' * (len(bodies) != 1)}{moving}{', a region' if roi else ''}"
    return f"{path}: {found}; piv correlate --mask {path.name}"

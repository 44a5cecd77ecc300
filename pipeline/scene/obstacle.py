"""[[obstacle]]: fixed bodies beside a finger, centred on the laser sheet along z."""

from itertools import combinations, pairwise
from typing import Annotated, Any, Literal

import numpy as np
import shapely
from numpy import ndarray
from pydantic import Field, field_validator, model_validator

from pipeline.scene.section import Pair, Positive, Section

_MOST_OBSTACLES = 8
_MOST_CORNERS = 5000
_SMOOTH = 30.0  # degrees; a corner that turns less is one of a curve, not the end of a side
_SHORTEST = 0.5  # of a wall cell; shorter sides are merged
_POINTS = 2000  # about, of an outline of many sides
_CIRCLE_POINTS = 720  # before nodes are spread over it
_EDGE_POINTS = 50  # of a straight side, likewise


class Obstacle(Section):
    """A fixed body in the water, which the camera sees; lengths in m."""

    shape: Literal["circle", "box", "polygon"]
    """Of its section by the sheet"""
    centre: Pair | None = None
    """Of a circle or box, x and y in the tank frame [m]"""
    diameter: Positive | None = None
    """Of a circle [m]"""
    size: tuple[Positive, Positive] | None = None
    """Width and height of a box [m]"""
    points: Annotated[tuple[Pair, ...], Field(min_length=3)] | None = None
    """Corners of a polygon, in order, in the tank frame [m]"""
    depth: Positive | None = None
    """Extent along z; absent: from wall to wall [m]"""

    @field_validator("points", mode="after")
    @classmethod
    def _distinct(cls, points: tuple[tuple[float, float], ...] | None) -> Any:
        """A corner that repeats the one before it is dropped."""
        if points is None:
            return None
        return tuple(b for a, b in pairwise((points[-1], *points)) if a != b) or points[:1]

    @model_validator(mode="after")
    def _whole(self) -> "Obstacle":
        needed = {"circle": ("centre", "diameter"), "box": ("centre", "size")}
        keys = needed.get(self.shape, ("points",))
        if missing := [key for key in keys if getattr(self, key) is None]:
            raise ValueError(f"shape = {self.shape!r} needs {missing[0]}; add it")
        for key in ("centre", "diameter", "size", "points"):
            if key not in keys and getattr(self, key) is not None:
                raise ValueError(f"{key} is not of shape = {self.shape!r}; remove it")
        if self.points and len(self.points) > _MOST_CORNERS:
            raise ValueError(f"points: {len(self.points)} corners; give at most {_MOST_CORNERS}")
        if self.points and shapely.MultiPoint(self.points).convex_hull.area == 0:
            raise ValueError("points: the corners enclose no area; give three or more that do")
        if not self.polygon.is_valid:
            raise ValueError("points: the sides cross each other; give the corners in order")
        return self

    @property
    def pieces(self) -> tuple[ndarray, ...]:
        """Polylines (point, 2) between its corners, counter-clockwise, head to tail, m.

        Corners of a polygon that turn by little are those of a curve, as a circle's.
        """
        if self.shape == "circle":
            turn = np.linspace(0.5, 2.5, _CIRCLE_POINTS + 1) * np.pi
            circle = np.column_stack([np.cos(turn), np.sin(turn)])
            circle[-1] = circle[0]
            return (self._middle + 0.5 * (self.diameter or 0.0) * circle,)
        ring = shapely.orient_polygons(self.polygon).exterior
        corners = shapely.get_coordinates(ring)[:-1]
        sides = np.roll(corners, -1, axis=0) - corners
        ahead = np.arctan2(sides[:, 1], sides[:, 0])
        turn = np.abs((ahead - np.roll(ahead, 1) + np.pi) % (2 * np.pi) - np.pi)
        sharp = np.flatnonzero(turn > np.radians(_SMOOTH))
        ends = sharp if len(sharp) else np.zeros(1, int)
        count = max(2, min(_EDGE_POINTS, _POINTS // len(corners)))
        pieces = []
        for first, last in zip(ends, [*ends[1:], ends[0] + len(corners)], strict=True):
            line = corners[np.arange(first, last + 1) % len(corners)]
            parts = [np.linspace(a, b, count) for a, b in pairwise(line)]
            pieces.append(np.vstack([parts[0], *(part[1:] for part in parts[1:])]))
        return tuple(pieces)

    def merged(self, wall_cell: float) -> "Obstacle":
        """The obstacle without the polygon's sides shorter than half a `wall_cell` (m)."""
        corners = np.array(self.points if self.points else [])
        while len(corners) > 3:
            ahead = np.roll(corners, -1, axis=0)
            length = np.hypot(*(ahead - corners).T)
            k = int(length.argmin())
            if length[k] >= _SHORTEST * wall_cell:
                break
            corners[(k + 1) % len(corners)] = 0.5 * (corners[k] + ahead[k])
            corners = np.delete(corners, k, axis=0)
        if not self.points or len(corners) == len(self.points):
            return self
        points = tuple((float(x), float(y)) for x, y in corners)
        return Obstacle.model_validate(self.model_dump() | {"points": points})

    @property
    def polygon(self) -> shapely.Polygon:
        """Section of the obstacle by the sheet."""
        if self.shape == "circle":
            return shapely.Polygon(self.pieces[0])
        if self.shape == "box":
            low = self._middle - 0.5 * np.array(self.size)
            return shapely.box(*low, *(2 * self._middle - low))
        return shapely.Polygon(self.points)

    @property
    def _middle(self) -> ndarray:
        return np.array(self.centre)

    def half_depth(self, tank_depth: float) -> float:
        """Half of the extent along z, m."""
        return 0.5 * (self.depth or tank_depth)


def merge_short_sides(
    obstacles: tuple[Obstacle, ...], wall_cell: float
) -> tuple[tuple[Obstacle, ...], list[str]]:
    """Obstacles whose sides cells of `wall_cell` (m) can follow, and a remark on each changed one.

    ValueError where the merged sides cross each other.
    """
    merged, remarks = [], []
    for number, thing in enumerate(obstacles):
        try:
            merged.append(new := thing.merged(wall_cell))
        except ValueError:
            raise ValueError(
                f"obstacle[{number}].points: its sides shorter than {_SHORTEST:g} mesh.wall_cell"
                f" = {_SHORTEST * wall_cell:.2g} m cannot be merged; give fewer corners"
            ) from None
        if new is not thing:
            apart = shapely.hausdorff_distance(thing.polygon, new.polygon)
            count = len(thing.points or ()) - len(new.points or ())
            remarks.append(
                f"obstacle[{number}].points: {count} sides shorter"
                f" than {_SHORTEST:g} mesh.wall_cell = {_SHORTEST * wall_cell:.2g} m are"
                f" merged; the outline moves by up to {1e3 * apart:.2g} mm"
            )
    return tuple(merged), remarks


# the walls of the obstacles, in order
OBSTACLE_PATCHES = tuple(f"obstacle_{number + 1}" for number in range(_MOST_OBSTACLES))


def forces_name(patch: str) -> str:
    """OpenFOAM's function object that samples the forces on an obstacle."""
    return f"{patch}Forces"


def check_obstacles(scene: Any) -> None:
    """ValueError where obstacles do not lie apart from each other and from the walls, in water."""
    obstacles, tank, finger = scene.obstacle or (), scene.tank, scene.finger
    if not obstacles:
        return
    if scene.pinch is not None or scene.body is not None:
        raise ValueError("obstacle: goes with a single finger; remove [[obstacle]], or the other")
    if len(obstacles) > _MOST_OBSTACLES:
        raise ValueError(f"obstacle: {len(obstacles)} tables; give at most {_MOST_OBSTACLES}")
    room = 2 * scene.mesh.wall_cell
    half = 0.5 * tank.size[0]
    water = shapely.box(-half + room, room, half - room, tank.water_depth - room)
    for number, thing in enumerate(obstacles):
        where, (x0, y0, x1, y1) = f"obstacle[{number}]", thing.polygon.bounds
        if not water.contains(thing.polygon):
            raise ValueError(
                f"{where} reaches x from {x0:g} to {x1:g} m and y from {y0:g} to {y1:g} m; keep it"
                f" within {-half + room:g} to {half - room:g} and {room:g} to"
                f" {tank.water_depth - room:g} m (2 mesh.wall_cell from walls and surface)"
            )
        if min(x1 - x0, y1 - y0) < room:
            raise ValueError(f"{where} is thinner than 2 mesh.wall_cell = {room:g} m; widen it")
        sides = {"tank.size[2]": tank.size[2], "finger.width": finger.width}
        for name, side in sides.items():
            depth = 2 * thing.half_depth(tank.size[2])
            if depth > tank.size[2] or 0 < abs(depth - side) < scene.mesh.edge_layer:
                raise ValueError(
                    f"{where}.depth = {depth:g} m is nearer to {name} = {side:g} m than"
                    f" mesh.edge_layer = {scene.mesh.edge_layer:g} m; give {side:g}"
                )
    if scene.support is not None:
        wide, high, _ = scene.support.size
        block = shapely.box(-wide / 2, scene.support.bottom, wide / 2, scene.support.bottom + high)
        if any(thing.polygon.distance(block) < room for thing in obstacles):
            raise ValueError("obstacle: meets [support]; move one of them")
    for a, b in combinations(range(len(obstacles)), 2):
        if obstacles[a].polygon.distance(obstacles[b].polygon) < room:
            raise ValueError(
                f"obstacle[{a}] and obstacle[{b}] are nearer than 2 mesh.wall_cell = {room:g} m;"
                " move one, or join them to a polygon"
            )

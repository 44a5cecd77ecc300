"""[[obstacle]]: fixed bodies beside a finger, centred on the laser sheet along z."""

from itertools import combinations, pairwise
from typing import Annotated, Any, Literal

import numpy as np
import shapely
from numpy import ndarray
from pydantic import Field, model_validator

from pipeline.scene.section import Pair, Positive, Section

_MOST_OBSTACLES = 8
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

    @model_validator(mode="after")
    def _whole(self) -> "Obstacle":
        needed = {"circle": ("centre", "diameter"), "box": ("centre", "size")}
        keys = needed.get(self.shape, ("points",))
        if missing := [key for key in keys if getattr(self, key) is None]:
            raise ValueError(f"shape = {self.shape!r} needs {missing[0]}; add it")
        for key in ("centre", "diameter", "size", "points"):
            if key not in keys and getattr(self, key) is not None:
                raise ValueError(f"{key} is not of shape = {self.shape!r}; remove it")
        if not self.polygon.is_valid:
            raise ValueError("points: the sides cross each other; give the corners in order")
        return self

    @property
    def pieces(self) -> tuple[ndarray, ...]:
        """Polylines (point, 2) between its corners, counter-clockwise, head to tail, m."""
        if self.shape == "circle":
            turn = np.linspace(0.5, 2.5, _CIRCLE_POINTS + 1) * np.pi
            circle = np.column_stack([np.cos(turn), np.sin(turn)])
            circle[-1] = circle[0]
            return (self._middle + 0.5 * (self.diameter or 0.0) * circle,)
        ring = shapely.orient_polygons(self.polygon).exterior
        corners = shapely.get_coordinates(ring)
        return tuple(np.linspace(a, b, _EDGE_POINTS) for a, b in pairwise(corners))

    @property
    def polygon(self) -> shapely.Polygon:
        """Its section by the sheet."""
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
        """Reach in |z|, m."""
        return 0.5 * (self.depth or tank_depth)


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

"""What the stages of a run will probably cost: from the costs measured before, for schedulers that must be told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fileio.formats.records import COST
from fileio.stages import BY_NAME, Stage
from pipeline.scene.scene import Scene

LEVELS = {
    "smoke": 0.15,
    "coarse": 1.0,
    "medium": 10.0,
    "fine": 80.0,
}  # of the cost of a run at coarse
MARGIN = 2.0  # of time and memory, over what is expected
LEAST_MINUTES, LEAST_MB = 5, 500


def estimates(scene: Scene, ranks: int, parent: Path) -> dict[str, dict[str, Any]]:
    """By stage: `minutes` and `memory_mb` to ask for, `source` (measured, or a guess from level coarse)."""
    return {name: _estimate(scene, stage, ranks, parent) for name, stage in BY_NAME.items()}


def _estimate(scene: Scene, stage: Stage, ranks: int, parent: Path) -> dict[str, Any]:
    for out in (scene.out, parent / "out" / scene.level):
        cost = _read(out / "costs" / f"{stage.name}.json")
        if cost is not None:
            seconds, memory, source = (
                cost["cpu_time"],
                cost["peak_memory"] / 1e6,
                "measured",
            )
            break
    else:
        seconds, memory = stage.cost
        share = LEVELS.get(scene.level, 1.0) * (2.0 if scene.model.kind == "full" else 1.0)
        if stage.ranks:
            seconds *= share
        memory *= max(1.0, share**0.5)
        source = "guess"
    cores = ranks if stage.ranks else 1
    minutes = max(LEAST_MINUTES, round(MARGIN * seconds / cores / 60))
    return {
        "minutes": minutes,
        "memory_mb": max(LEAST_MB, round(MARGIN * memory)),
        "source": source,
    }


def _read(path: Path) -> dict[str, Any] | None:
    try:
        cost = COST.read(path)
    except (OSError, ValueError):
        return None
    return cost

"""What the stages of a run will probably cost: from the costs measured before, for schedulers that must be told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from fileio.json_text import read_json
from pipeline.scene.scene import Scene
from pipeline.study.reuse import FILES, MODULES

# CPU seconds and memory (MB) of a stage of single_finger at level coarse, for a scene that was never run at its level.
COARSE = {
    "kinematics": (5, 400), "mesh": (40, 500), "case": (10, 500), "run": (300, 600), "sheet": (60, 500),
    "images": (120, 600), "piv": (120, 800), "vortices_cfd": (60, 500), "vortices_piv": (60, 500), "fea": (300, 600),
    "compare": (30, 600), "report": (90, 900),
}  # fmt: skip
LEVELS = {"smoke": 0.15, "coarse": 1.0, "medium": 10.0, "fine": 80.0}  # of the cost of a run at coarse
MARGIN = 2.0  # of time and memory, over what is expected
LEAST_MINUTES, LEAST_MB = 5, 500


def estimates(scene: Scene, ranks: int, parent: Path) -> dict[str, dict[str, Any]]:
    """By stage: `minutes` and `memory_mb` to ask for, `source` (measured, or a guess from level coarse)."""
    return {stage: _estimate(scene, stage, ranks, parent) for stage in (*FILES, "fea", "compare", "report")}


def _estimate(scene: Scene, stage: str, ranks: int, parent: Path) -> dict[str, Any]:
    name = f"{MODULES.get(stage, stage)}.json"
    for out in (scene.out, parent / "out" / scene.level):
        cost = _read(out / "costs" / name)
        if cost is not None:
            seconds, memory, source = (
                cost.get("cpu_time", cost["wall_time"]),
                cost["peak_memory"] / 1e6,
                "measured",
            )
            break
    else:
        seconds, memory = COARSE[stage]
        share = LEVELS.get(scene.level, 1.0) * (2.0 if scene.model.kind == "full" else 1.0)
        if stage == "run":
            seconds = int(seconds * share)
        memory = int(memory * max(1.0, share**0.5))
        source = "guess"
    cores = ranks if stage == "run" else 1
    minutes = max(LEAST_MINUTES, round(MARGIN * seconds / cores / 60))
    return {"minutes": minutes, "memory_mb": max(LEAST_MB, round(MARGIN * memory)), "source": source}


def _read(path: Path) -> dict[str, Any] | None:
    try:
        cost = read_json(path, "")
    except (OSError, ValueError):
        return None
    return cost if {"wall_time", "peak_memory"} <= cost.keys() else None

"""Straight elastic beams for the tests of the chain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.formats.bending_states import States
from pipeline.structure.chain import Chain
from pipeline.structure.elastic_law import constant_law


def beam(
    length: float, height: float, width: float, stiffness: float, pieces: int = 124, **law: Any
) -> Chain:
    """A beam (m, N m²) whose middle line is profile and neutral axis; four `pieces` to a slice."""
    line = np.stack([np.linspace(0, length, pieces + 1), np.zeros(pieces + 1)], -1)
    states = States(
        np.array([-1e3, 0.0, 1e3]), np.repeat(line[None], 3, 0), np.full((3, pieces + 1), height)
    )
    constant = constant_law(stiffness, 0.0, 3)
    return Chain(states, replace(constant, **{"rubber_section": width * height} | law), width)

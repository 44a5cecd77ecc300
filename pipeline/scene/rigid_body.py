"""The table of a rigid body in place of a finger, and the law of its motion."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pipeline.scene.section import NotNegative, Number, Pair, Positive, Section, Whole


class RigidBody(Section):
    """A rigid body in place of a finger; lengths in m."""

    shape: Literal["circle", "plate"]
    """Of its section"""
    centre: Pair
    """Where it begins, in the tank frame [m]"""
    diameter: Positive | None = None
    """Of a circle [m]"""
    chord: Positive | None = None
    """Of a plate [m]"""
    thickness: Positive | None = None
    """Of a plate [m]"""
    angle_deg: Number = 0.0
    """Of the chord from the x axis, counter-clockwise [deg]"""
    depth: Positive = 1.0
    """Extent along z; 2-D: forces are those on this depth [m]"""
    points: Annotated[Whole, Field(ge=24, le=20_000)] = 720
    """Of the outline"""

    @model_validator(mode="after")
    def _sized(self) -> "RigidBody":
        if (self.shape == "circle") != (self.diameter is not None):
            raise ValueError("give a diameter to a circle, and to a circle only")
        plate = self.chord is not None and self.thickness is not None
        if (self.shape == "plate") != plate or (not plate and (self.chord or self.thickness)):
            raise ValueError("give chord and thickness to a plate, and to a plate only")
        if self.chord and self.thickness and self.thickness >= self.chord:
            raise ValueError(
                f"thickness = {self.thickness} m is not less than the chord, {self.chord} m"
            )
        return self

    @property
    def size(self) -> float:
        """Diameter or chord, m."""
        return self.diameter or self.chord or 0.0


class Law(Section):
    """A displacement (m, along `direction_deg`) or a rotation (deg, counter-clockwise) over time.

    Both kinds begin through a smooth step of `smoothing` s that multiplies the amplitude, or the
    speed.
    """

    kind: Literal["sine", "power"]
    """Amplitude · sin(2π (t − start) / period), or a speed of rate · (t − start)^exponent"""
    start: NotNegative = 0.0
    """Of the motion [s]"""
    smoothing: Positive
    """Time of the smooth step that it begins through [s]"""
    direction_deg: Number = 0.0
    """Of a displacement, from the x axis [deg]"""
    amplitude: Number | None = None
    """Of a sine [m or deg]"""
    period: Positive | None = None
    """Of a sine [s]"""
    rate: Number | None = None
    """Of a power law [m or deg, per s^(exponent + 1)]"""
    exponent: Annotated[NotNegative, Field(le=4)] | None = None
    """Of a power law [1]"""

    @model_validator(mode="after")
    def _complete(self) -> "Law":
        wanted = {"sine": ("amplitude", "period"), "power": ("rate", "exponent")}
        for kind, keys in wanted.items():
            for key in keys:
                if (kind == self.kind) != (getattr(self, key) is not None):
                    raise ValueError(
                        f"kind = '{self.kind}' takes {' and '.join(wanted[self.kind])}, no more and"
                        " no less"
                    )
        return self

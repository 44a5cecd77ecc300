"""Settings of the correlation, shared by pairs, multi-frame sets, ensembles and commands."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import partial, wraps
from typing import Annotated, Any, TypedDict, TypeVar, cast, get_type_hints

import numpy as np

from piv.files.errors import suggestion

# Newton steps at half and at full resolution; how often the frequency weights are measured
PRESETS = {"fast": (2, 2, 1), "balanced": (3, 3, 1), "accurate": (4, 6, 2)}
WINDOW = (8, 512)  # px: bounds of Options.window


@dataclass(frozen=True)
class Options:
    """How images are correlated; lengths in px.

    `piv correlate --help` explains every field, which is an option there. ValueError where one is
    out of its range.

    Examples
    --------
    >>> piv.Options(window=24).sigma  # of the window's Gaussian weight
    6.0
    """

    window: Annotated[
        float, "side of the correlation window, px: its weight is a Gaussian of σ = window/4"
    ] = 32.0
    least_window: Annotated[
        float,
        "side to which it may shrink where the flow requires it, px; as large as window: never",
    ] = 12.0
    spacing: Annotated[int, "distance of the vectors, px"] = 8
    preset: Annotated[str, "fast, balanced or accurate"] = "balanced"
    passes: Annotated[int, "Newton steps at full resolution; 0 = those of the preset"] = 0
    smoothing: Annotated[bool, "damp what is no stronger than noise"] = True
    search: Annotated[
        int, "side of the first windows, px; displacements up to 3/8 of it are found"
    ] = 128
    epsilon: Annotated[float, "normalised median test: expected fluctuation, px"] = 0.2
    threshold: Annotated[float, "normalised median test: largest residual"] = 3.0
    # below twice as much a vector is an outlier where most of its neighbours are
    min_correlation: Annotated[float, "least correlation coefficient of a valid vector"] = 0.2
    # in turbulence of 2.5 px one in fifty of the others is then wrong by over half a pixel
    max_std: Annotated[
        float, "largest standard uncertainty of a valid vector, px; up to 1 px kept, flagged 5"
    ] = 0.2
    max_masked: Annotated[float, "largest masked share of a window's weight"] = 0.5
    replace: Annotated[bool, "put the neighbours' mean in place of outliers, flagged 4"] = False

    def __post_init__(self) -> None:
        for name in ("window", "least_window", "spacing", "search"):
            if np.ndim(getattr(self, name)):
                raise ValueError(
                    f"{name} is one number, the same along x and y, got {getattr(self, name)}; "
                    "windows shrink by themselves where the flow requires it (least_window)"
                )
        if self.preset not in PRESETS:
            raise ValueError(f"preset must be one of {', '.join(PRESETS)}, got {self.preset!r}")
        if not WINDOW[0] <= self.window <= WINDOW[1]:
            raise ValueError(
                f"window must be between {WINDOW[0]} and {WINDOW[1]} px, got {self.window}"
            )
        most = max(self.window, Options.least_window)
        if not 8 <= self.least_window <= most:
            raise ValueError(
                f"least_window must be between 8 and {most:g} px (window), got "
                f"{self.least_window:g}"
            )
        if not (self.spacing >= 1 and float(self.spacing).is_integer()):
            raise ValueError(
                f"spacing must be a whole number of px, at least 1, got {self.spacing}"
            )
        if not 16 <= self.search <= 1024:
            raise ValueError(f"search must be between 16 and 1024 px, got {self.search}")
        if not 0 <= self.passes <= 50:
            raise ValueError(f"passes must be between 0 and 50, got {self.passes}")
        for name in ("epsilon", "threshold", "max_std"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}")
        if not 0 <= self.max_masked < 1 or not -1 <= self.min_correlation < 1:
            raise ValueError("max_masked must be within 0 … 1 and min_correlation within -1 … 1")

    @property
    def sigma(self) -> float:
        """Standard deviation of the window's Gaussian weight, px."""
        return self.window / 4

    @property
    def half_steps(self) -> int:
        """Newton steps at half resolution."""
        return PRESETS[self.preset][0]

    @property
    def full_steps(self) -> int:
        """Newton steps at full resolution."""
        return self.passes or PRESETS[self.preset][1]

    @property
    def spectra(self) -> int:
        """Number of times that the frequency weights are measured."""
        return PRESETS[self.preset][2]


class OptionWords(TypedDict, total=False):
    """The fields of `Options` as keywords, for editors and type checkers."""

    window: float
    least_window: float
    spacing: int
    preset: str
    passes: int
    smoothing: bool
    search: int
    epsilon: float
    threshold: float
    min_correlation: float
    max_std: float
    max_masked: float
    replace: bool


F = TypeVar("F", bound=Callable[..., Any])


def with_fields(*kinds: type) -> Callable[[F], F]:
    """The function with the fields of dataclasses as keywords in its signature.

    It raises TypeError with the nearest spelling for another keyword.
    """
    return partial(_with_fields, kinds)


def _with_fields(kinds: tuple[type, ...], function: F) -> F:
    signature = inspect.signature(function)
    own = [p for p in signature.parameters.values() if p.kind is not p.VAR_KEYWORD]
    keyword = inspect.Parameter.KEYWORD_ONLY
    hints = {name: hint for kind in kinds for name, hint in get_type_hints(kind).items()}
    more = [inspect.Parameter(f.name, keyword, default=f.default, annotation=hints[f.name])
            for kind in kinds for f in fields(cast(Any, kind))]  # fmt: skip
    known = [*(p.name for p in own), *hints]

    @wraps(function)
    def checked(*args: Any, **words: Any) -> Any:
        for name in words:
            if name not in known:
                near = suggestion(name, known) or f"; known are {', '.join(hints)}"
                raise TypeError(f"{function.__name__}() has no option {name!r}{near}")
        return function(*args, **words)

    checked.__signature__ = signature.replace(parameters=[*own, *more])  # type: ignore[attr-defined]
    return cast(F, checked)


with_options = with_fields(Options)

"""Checks, results files and the ledger made from them."""

import json

import numpy as np
import pytest

from docs.evidence.validation.checks import Check, Result, write_result
from docs.evidence.validation.cylinders import cycle_of, history_integral, morison
from docs.evidence.validation.ledger import write_ledger


def check(result, how="relative", reference=2.0, **more):
    return Check("a.b", "thing", result, 0.1, how, "because", reference, **more)


@pytest.mark.parametrize(
    "made, met",
    [
        (check(2.19), True), (check(2.21), False), (check(1.79), False),
        (check(2.09, "absolute"), True), (check(2.11, "absolute"), False),
        (check(0.1, "at most", None), True), (check(0.11, "at most", None), False),
        (check(0.1, "at least", None), True), (check(0.09, "at least", None), False),
        (check(float("nan")), False), (check(float("nan"), "at most", None), False),
    ],
)  # fmt: skip
def test_a_check_is_met_within_its_tolerance_only(made, met):
    assert made.met is met


def test_a_check_without_reference_cannot_be_relative():
    with pytest.raises(ValueError, match="do not fit"):
        check(1.0, "relative", None)


def test_the_ledger_lists_every_check_and_the_missed_ones(tmp_path):
    curves = {"time": [0.1, 0.2], "drag": [1.0, 0.9], "friction": [0.5, 0.4]}
    curves |= {"reference_time": [0.15], "reference_drag": [1.0]}
    good = Result("impulsive_cylinder", "Title one", (check(2.0),), curves)
    bad = Result("finger", "Title two", (check(3.0, unit="m"),))
    for result in (good, bad):
        write_result(result, tmp_path / f"{result.name}.json")
    assert write_ledger(tmp_path) == 1
    tables = (tmp_path / f"{name}.csv" for name in ("checks", "flows", "missed"))
    checks, flows, missed = (table.read_text().splitlines() for table in tables)
    assert [row.split(",")[7] for row in checks] == ["met", "met", "missed"]
    scores = [row.split(",")[:2] for row in flows[1:]]
    assert scores == [["Title one", "1 of 1"], ["Title two", "0 of 1"]]
    assert missed[1:] == ["thing,3 m,2 m ± 10 %"]
    assert (tmp_path / "impulsive_cylinder.svg").stat().st_size > 1000
    assert json.loads((tmp_path / "finger.json").read_text())["checks"][0]["met"] is False


def test_morison_coefficients_are_recovered():
    t = np.linspace(0, 1, 400, endpoint=False)
    u, a = np.cos(2 * np.pi * t), -np.sin(2 * np.pi * t)
    force = -0.5 * 2.1 * np.abs(u) * u - 0.25 * np.pi * 1.45 * a
    assert morison(u, a, force, 1.0, 1.0) == pytest.approx((2.1, 1.45))
    time = np.linspace(0, 3, 601)
    quarter = cycle_of(time, np.sin(2 * np.pi * time), 1.0, np.array([0.25]))
    assert quarter[0] == pytest.approx(1, abs=1e-4)


def test_the_history_integral_of_a_constant_and_of_a_ramp():
    t = np.linspace(0, 2, 21)
    # ∫ dτ/√(t−τ) = 2√t and ∫ τ/√(t−τ) dτ = 4/3 t^1.5: the rule is exact for both
    assert history_integral(t, np.ones_like(t), 1.5) == pytest.approx(2 * np.sqrt(1.5), rel=1e-12)
    assert history_integral(t, t, 1.23) == pytest.approx(4 / 3 * 1.23**1.5, rel=1e-12)

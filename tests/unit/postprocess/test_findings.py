"""The schema of findings.toml and its judgement."""

from pathlib import Path

import numpy as np
import pytest

from postprocess.compare.findings import Finding, is_met, read_findings
from postprocess.compare.quantities import QUANTITIES
from postprocess.compare.stage import judge
from postprocess.evidence.evidence import Evidence, Quantity
from postprocess.evidence.time_windows import Clock
from postprocess.words import measured_text, quantity
from tests.conftest import CASES
from tests.synthetic_stroke import vortex_table

ROOT = Path(__file__).parents[3]
CLOCK = np.array([0.0, 1.0])
GOOD = """
format = "findings"
format_version = 1
[[finding]]
id = "a"
kind = "agreement"
finding = "PIV agrees."
figure = ""
quantity = "centre_distance"
of = ["piv-cfd"]
comparison = "<="
value = 1.5e-3
reason = "Because."
window = [0.25, 0.75]
"""
ENTRY = GOOD[GOOD.index("[[finding]]") :]


def write(tmp_path, text):
    path = tmp_path / "findings.toml"
    path.write_text(text)
    return path


def finding(comparison, value, tolerance=0.0):
    asked = {"comparison": comparison, "value": value, "tolerance": tolerance}
    more = {"figure": "", "quantity": "q", "of": ("cfd",), "reason": "r", "window": [0.0, 1.0]}
    return Finding(id="a", kind="paper", finding="f", **asked, **more)


@pytest.mark.parametrize(
    "comparison, value, tolerance, measured, expected",
    [
        ("<=", 0.05, 0.0, 0.05, True),
        ("<=", 0.05, 0.0, 0.0501, False),
        ("<=", 0.05, 0.01, 0.06, True),
        (">=", 0.9, 0.0, 0.89, False),
        (">=", 0.9, 0.02, 0.89, True),
        ("in range", (1.0, 2.0), 0.0, 2.1, False),
        ("in range", (1.0, 2.0), 0.2, 2.1, True),
        ("in range", (1.0, 2.0), 0.2, 0.7, False),
        ("equals", 3.0, 0.1, 3.05, True),
        ("equals", 3.0, 0.1, 2.8, False),
        ("equals", "dorsal", 0.0, "dorsal", True),
        ("equals", "dorsal", 0.0, "ventral", False),
        ("equals", "dorsal", 0.0, "", False),
    ],
)
def test_judgement(comparison, value, tolerance, measured, expected):
    assert is_met(finding(comparison, value, tolerance), measured) is expected


@pytest.mark.parametrize(
    "end, met_by, met",
    [
        (2.0, {"cfd": True}, True),
        (0.5, {"cfd": False}, False),
        (ValueError("so slow a flow was not run before"), {"cfd": False}, False),
        (FileNotFoundError("the single finger has not been made"), {}, None),
    ],
)
def test_what_cannot_be_measured_is_not_met_and_what_is_not_there_is_not_judged(
    monkeypatch, end, met_by, met
):
    def measure(part):
        if isinstance(end, Exception):
            raise end
        return end

    monkeypatch.setitem(QUANTITIES, "q", Quantity(measure, "1", "a number"))
    check = judge(finding(">=", 1.0), Evidence({"cfd": None}, {}, 1.0, Clock(CLOCK, CLOCK)))
    assert check["met_by"] == met_by
    assert check["met"] is met
    assert check["notes"] == ([str(end)] if isinstance(end, Exception) else [])


@pytest.mark.parametrize(
    "path", sorted(CASES.glob("*/reference/findings.toml")), ids=lambda p: p.parts[-3]
)
def test_every_scene_s_findings_are_valid_and_give_reasons(path):
    findings = read_findings(path, frozenset(QUANTITIES))
    short = [f.id for f in findings if len(f.reason) <= 20]
    assert not short, f"{short}: say in `reason` why this value and tolerance"
    assert all(f.figure for f in findings if f.kind == "paper")


def test_single_finger_asks_for_what_the_project_promises():
    path = CASES / "single_finger/reference/findings.toml"
    asked = {f.quantity: f for f in read_findings(path, frozenset(QUANTITIES))}
    assert asked["circulation_difference"].value <= 0.05
    assert asked["centre_distance"].value <= 1.5e-3
    assert asked["dominant_side"].value == "dorsal"
    assert asked["dominant_side"].of == ("cfd", "piv")


@pytest.mark.parametrize(
    "old, new, message",
    [
        ('id = "a"', "", "id: this key is missing"),
        ('reason = "Because."', 'reason = " "', "reason: .* at least 1 character"),
        ('= "centre_distance"', '= "beauty"', "quantity = 'beauty' is not one of"),
        ("window = [0.25, 0.75]", "window = [0.75, 0.25]", "must be two fractions"),
        ("window = [0.25, 0.75]", "window = [0.25, 0.75]\ncolour = 1", "colour: .* not known"),
        ('comparison = "<="', 'comparison = "in range"', r"needs value = \[low, high\]"),
        ("value = 1.5e-3", 'value = "small"', "only be compared by 'equals'"),
        ('of = ["piv-cfd"]', 'of = ["guess"]', "of.*guess"),
        ('= ["piv-cfd"]', '= ["cfd", "lab"]', "of.*lab"),
        ('= ["piv-cfd"]', "= []", "of: .* at least 1"),
        ("value = 1.5e-3", "value = 1.5e-3\ntolerance = -1", "tolerance: .* equal to 0"),
        ("format_version = 1", "format_version = 2", "format_version of this findings file is 2"),
        ('kind = "agreement"', "kind = agreement", "not valid TOML"),
        (ENTRY, 2 * ENTRY, "occurs twice"),
        (ENTRY, "", "at least one"),
    ],
)
def test_bad_entries_are_refused_in_one_sentence(tmp_path, old, new, message):
    with pytest.raises(ValueError, match=message) as caught:
        read_findings(write(tmp_path, GOOD.replace(old, new)), frozenset(QUANTITIES))
    assert "findings.toml" in str(caught.value)


def test_what_was_measured_is_printed_in_words():
    check = {"unit": "m", "measured": {"cfd": 0.0012345, "piv": None}}
    assert measured_text(check) == "CFD: 1.23\u00a0mm, PIV: –"
    assert measured_text({"unit": "", "measured": {"cfd": "dorsal"}}) == "CFD: dorsal"


@pytest.mark.parametrize(
    "value, unit, text",
    [
        (3e-6, "m²/s", "0.03 cm²/s"),
        (-3.21e-10, "m²/s", "−0.00000321 cm²/s"),
        (9.09e-3, "m²/s", "90.9 cm²/s"),
        (0.12345, "m²/s", "1234 cm²/s"),
        (0.0, "m³/s", "0 cm³/s"),
        (4.2e-8, "m³/s²", "0.042 cm³/s²"),
        (2e-5, "m/s", "0.00002 m/s"),
        (0.5, "s", "0.5 s"),
        (-1370.0, "Pa", "−1370 Pa"),
        (98.94, "1", "98.9"),
        (0.99962, "1", "0.9996"),
        (0.123, "fraction", "12.3 %"),
        (0.0012345, "m", "1.23 mm"),
        (1.0, "rad", "57.3°"),
        (2.5, "tip widths", "2.5 tip widths"),
        ("dorsal", "", "dorsal"),
        (None, "m", "–"),
    ],
)
def test_small_values_keep_their_digits_without_an_exponent(value, unit, text):
    assert quantity(value, unit).replace("\u00a0", " ") == text


@pytest.mark.parametrize("seen, met", [(slice(70, 75), None), (slice(0), False)])
def test_what_both_see_too_briefly_is_undecided_and_what_piv_never_sees_is_not_met(seen, met):
    time = np.linspace(0, 0.4, 81)
    table = vortex_table(time, np.radians(100))
    flow = table[table["track"] == 3].reset_index(drop=True)
    tables = {"cfd": flow, "piv": flow[flow["time"].isin(time[seen])]}
    evidence = Evidence({"cfd": None, "piv": None}, tables, 1.0, Clock(time, time))
    values = {"kind": "agreement", "quantity": "centre_distance", "of": "piv-cfd"}
    asked = {**finding("<=", 1e-3).model_dump(), **values, "window": "known"}
    check = judge(Finding(**asked), evidence)
    assert check["met"] is met
    assert ("too briefly" in check["cure"]) is (met is None)

"""Integrals of exact vortex pairs beside two tips, also where their cores overlap."""

import numpy as np
import pandas as pd
import pytest

from piv.formats.plane_series import make_plane
from piv.vortices.table import tabulate_vortices
from postprocess.evidence import pair_integrals as integrals
from postprocess.evidence.tip_vortex import of_disc

WIDTH = 0.0167
TIPS = np.array([[[-0.010, 0.18], [0.010, 0.18]]])


def plane(*vortices, spacing=0.0005, tips=TIPS):
    """Lamb-Oseen vortices (x, y, Γ, r_c), mirrored in x = 0, between two level fingers."""
    x, y = np.arange(-0.08, 0.08 + 1e-9, spacing), np.arange(0.11, 0.25, spacing)
    gx, gy = np.meshgrid(x, y)
    u, v = np.zeros_like(gx), np.zeros_like(gx)
    for x0, y0, circulation, core in (*vortices, *((-a, b, -g, r) for a, b, g, r in vortices)):
        dx, dy = gx - x0, gy - y0
        r2 = np.maximum(dx**2 + dy**2, 1e-16)
        swirl = circulation / (2 * np.pi * r2) * -np.expm1(-r2 / core**2)
        u, v = u - swirl * dy, v + swirl * dx
    box = np.array([[-0.04, 0.184], [-0.04, 0.176], [-0.010, 0.176], [-0.010, 0.184]])
    inside = (np.abs(gx) >= 0.010) & (np.abs(gx) <= 0.04) & (np.abs(gy - 0.18) <= 0.004)
    return make_plane(
        x, y, *(np.where(inside, np.nan, field)[None] for field in (u, v)),
        time=np.array([0.5]), outline=np.stack([box, box * [-1, 1]])[None], tip=tips,
        tip_direction=np.array([[[1.0, 0.0], [-1.0, 0.0]]]),
        dorsal_direction=np.array([[[0.0, -1.0], [0.0, -1.0]]]),
        bend=np.zeros((1, 2)),
    ).assign_attrs(tip_width=WIDTH)  # fmt: skip


DORSAL, VENTRAL = (-0.016, 0.155, -100e-4, 0.004), (-0.008, 0.200, 30e-4, 0.003)


def found(*vortices):
    """The pairs among the vortices of a plane."""
    series = plane(*vortices)
    return integrals.pair_integrals(series, of_disc(tabulate_vortices(series)))


def test_both_pairs_are_told_apart_and_measured():
    table = found(DORSAL, VENTRAL)
    pairs = {integrals.DORSAL: DORSAL, integrals.VENTRAL: VENTRAL}
    for (side, flow), (x, y, circulation, core) in pairs.items():
        for finger, sign in ((0, 1), (1, -1)):
            row = integrals.vortex_of(table, side, flow, finger).iloc[0]
            # within half a tip's width of a lone vortex; the other's strain takes some off
            scale = WIDTH / 6
            part = -np.expm1(-((3 * scale) ** 2) / (core**2 + 2 * scale**2))
            assert row["circulation"] == pytest.approx(part * sign * circulation, rel=0.06)
            assert (row["x"], row["y"]) == pytest.approx((sign * x, y), abs=3e-4)
            wide = 1.12 * np.hypot(core, np.sqrt(2) * scale)  # smoothed
            assert row["radius"] == pytest.approx(wide, rel=0.05)
        pair = integrals.pair_of(table, side, flow).iloc[0]
        assert np.sign(pair["between"]) == integrals.FLOWS[flow]
    assert len(table) == 4  # nothing else is taken for a vortex


def test_the_tip_vortex_of_the_literal_reading_is_told_from_the_other_pair():
    table = found((-0.010, 0.200, -50e-4, 0.003))
    assert set(table["side"]) == {"ventral"}
    assert set(table["flow"]) == {"downward"}
    assert integrals.pair_of(table, *integrals.VENTRAL).empty


TIMES = np.arange(0, 0.1, 0.005)


def risen(there, y):
    return pd.DataFrame({"time": TIMES, "x": -0.005, "y": y})[there]


def test_a_pair_has_formed_when_it_lasts():
    there = (TIMES > 0.012) & (TIMES < 0.025) | (TIMES > 0.038)
    assert integrals.formed(TIMES, risen(there, 0.2), WIDTH) == pytest.approx(0.040)
    assert integrals.formed(TIMES, risen(TIMES < 0, 0.2), WIDTH) is None


@pytest.mark.parametrize("jump, forms", [(0.9, 0.015), (1.1, 0.035)])
def test_regions_that_jump_by_a_tip_width_are_no_pair_that_lasts(jump, forms):
    """To and fro until 0.035 s, as layers along the walls do, and in place from then on."""
    to_and_fro = np.where(TIMES < 0.038, jump * WIDTH * (np.arange(TIMES.size) % 2), jump * WIDTH)
    found_at = integrals.formed(TIMES, risen(TIMES > 0.012, 0.2 + to_and_fro), WIDTH)
    assert found_at == pytest.approx(forms)


def test_a_side_is_not_told_once_its_largest_vortex_has_met_the_edge():
    """What is the largest that is still measured was a lesser one before."""
    rows = [
        {"time": t, "finger": 0, "at_edge": int(t > 0.1 and peak < -9), "peak_vorticity": peak,
         "radius": 0.005}
        for t in (0.1, 0.2, 0.3) for peak in (-10.0, -3.0, 4.0)
    ]  # fmt: skip
    left = integrals.seen_whole(pd.DataFrame(rows))
    assert left["time"].tolist() == [0.1, 0.1, 0.1, 0.2, 0.3]
    assert left["peak_vorticity"].tolist() == [-10.0, -3.0, 4.0, 4.0, 4.0]

"""The twin: bands of a fit that are known, silhouettes of a film, a finger found again."""

import json

import cv2
import numpy as np
import pytest

from pipeline.scene.scene import load_scene
from piv.files.errors import StageError
from postprocess.lab.pose import Pose
from softfinger.identify import identify
from softfinger.twin.film import Film, read_film
from softfinger.twin.fit import Parameter, fit, independent_share
from softfinger.twin.model import (
    GROWTH,
    LOADS,
    LOSS,
    START,
    STIFF,
    Stroke,
    Twin,
    read_stroke,
    scaled,
    tip_of,
)
from tests.conftest import CASES

SIZE, MM, ROOT = (480, 640), 0.25, (250.0, 79.0)  # px, mm, px with y down
RISE = "t,p\n" + "".join(f"{t:.3f},{15e3 * min(max(t - 0.02, 0) / 0.04, 1):.1f}\n" for t in
                         np.arange(0, 0.32, 0.01))  # fmt: skip


def twin_of() -> Twin:
    scene = load_scene(CASES / "single_finger", "draft")
    return Twin(scene, Pose(MM, 0.0, scene.finger.root, (ROOT[0], SIZE[0] - 1 - ROOT[1])))


def test_bands_hold_the_truth_of_noise_that_is_independent():
    """Of 200 lines with a prior, 95 % of the bands hold slope and level, within 3 %."""
    x, held = np.linspace(0, 1, 40), []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        truth = {"slope": 2.0 * np.exp(0.3 * rng.normal()), "level": rng.normal()}
        data = truth["slope"] * x + truth["level"] + 0.2 * rng.normal(size=40)
        line = lambda v, data=data: [(v["slope"] * x + v["level"] - data)[:, None]]  # noqa: E731
        found = fit(
            [Parameter("slope", 2.0, 0.3, ratio=True), Parameter("level", 0.0, 1.0)], line, 0.2
        )
        held += [
            low < truth[row["name"]] < high for row in found.table() for low, high in [row["band"]]
        ]
    assert np.mean(held) == pytest.approx(0.95, abs=0.03)


def test_what_the_data_do_not_tell_stays_at_its_prior_and_is_named():
    x = np.linspace(0, 1, 20)[:, None]
    found = fit(
        [Parameter("a", 1.0, 0.5), Parameter("b", 3.0, 0.5)], lambda v: [v["a"] * x - 1.2 * x], 0.01
    )
    first, second = found.table()
    assert first["told"]
    assert first["value"] == pytest.approx(1.2, abs=0.01)
    assert not second["told"]
    assert second["value"] == pytest.approx(3.0)
    assert second["band"] == pytest.approx([3 - 0.98, 3 + 0.98], abs=0.01)


def test_smooth_residuals_count_less():
    rng = np.random.default_rng(1)
    rough = rng.normal(size=(200, 30))
    smooth = np.repeat(rng.normal(size=(20, 30)), 10, axis=0)
    assert independent_share([rough]) > 0.7
    assert independent_share([smooth]) < 0.2


def test_a_stiffer_rubber_has_the_shapes_of_a_lower_pressure():
    twin = twin_of()
    stiff = scaled(twin.states, 1.25, 1.1)
    k = int(np.argmin(np.abs(stiff.pressure - 20e3)))
    at = int(np.argmin(np.abs(twin.states.pressure - 16e3)))
    assert stiff.pressure[k] == pytest.approx(20e3)
    np.testing.assert_array_equal(stiff.profile[k], twin.states.profile[at])
    np.testing.assert_allclose(stiff.law.moment, 1.375 * twin.states.law.moment)


def filmed(folder, twin, values, pressure, count=30, rate=100.0):
    """Pictures of a dark finger before a bright wall, as a camera on `values` sees it."""
    folder.mkdir()
    none = np.zeros((1, 1, 1))
    film = Film(folder.name, np.arange(count) / rate, none, none)
    rng = np.random.default_rng(3)
    for k, outline in enumerate(twin.seen(values, Stroke(film, pressure))):
        back = outline[[0, -1]] - outline[[3, -4]]
        outline = np.vstack([outline[0] + 3 * back[0], outline, outline[-1] + 3 * back[1]])
        picture = np.full(SIZE, 180, np.uint8)
        corners = np.column_stack([outline[:, 0], SIZE[0] - 1 - outline[:, 1]])
        cv2.fillPoly(picture, [np.rint(16 * corners).astype(np.int32)], 60, cv2.LINE_AA, 4)
        noisy = np.clip(picture + rng.normal(0, 4, SIZE), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"f{k:03d}.png"), noisy)


def test_a_film_without_a_finger_is_one_sentence(tmp_path):
    twin = twin_of()
    cv2.imwrite(str(tmp_path / "f0.png"), np.full(SIZE, 120, np.uint8))
    with pytest.raises(StageError, match="no finger is told from its background"):
        read_film(tmp_path, 50.0, twin.pose, twin.at_rest(), 1.0)
    with pytest.raises(StageError, match="pictures have no times; give --rate"):
        read_film(tmp_path, None, twin.pose, twin.at_rest(), 1.0)


def asked(folder, more):
    """Films a and b of one finger, and another in c; identify with `more` options."""
    (folder / "p.csv").write_text(RISE)
    for name in "abc":
        (folder / name).mkdir()
        size = (100, 100) if name == "c" else SIZE
        cv2.imwrite(str(folder / name / "f0.png"), np.full(size, 120, np.uint8))
    given = {"film": [folder / "a"], "pressure": [folder / "p.csv"], "rate": 100.0, "scale": MM}
    given |= {"root": "250,79", "output": folder / "twin"}
    identify(CASES / "single_finger", **given | more(folder))


@pytest.mark.parametrize(
    "more, words",
    [
        (lambda _: {"rate": 0.0}, "`rate` must be positive, got 0"),
        (lambda _: {"rate": -100.0}, "`rate` must be positive, got -100"),
        (lambda _: {"scale": -MM}, "--scale -0.25: give mm per pixel"),
        (lambda _: {"scale": np.nan}, "--scale nan: give mm per pixel"),
        (lambda _: {"root": "1.2.3,4"}, "give column and row of the root's middle"),
        (lambda p: {"hold_out": p / "a", "pressure": [p / "p.csv"] * 2}, "two films have this nam"),
        (lambda p: {"hold_out": p / "c", "pressure": [p / "p.csv"] * 2}, "films of different size"),
    ],
)
def test_a_wrong_option_is_one_sentence_before_anything_is_fitted(tmp_path, more, words):
    """Rate 0 ended in a traceback; a negative rate or scale, or a film twice, was fitted."""
    with pytest.raises(StageError, match=words):
        asked(tmp_path, more=more)
    assert not (tmp_path / "twin").exists()


def test_a_scene_that_uses_no_bending_states_is_refused(tmp_path):
    """Its twin was written, and its runs would not have used what was fitted."""
    (tmp_path / "scene.toml").write_text(
        f'extends = "{CASES / "single_finger"}"\n[motion]\nsource = "paper_equations"\n'
    )
    with pytest.raises(StageError, match="'paper_equations' uses no bending states"):
        identify(tmp_path, film=[tmp_path], pressure=[tmp_path], scale=MM, root="1,2")


def test_a_film_ends_with_its_pressure_and_begins_on_its_clock(tmp_path):
    twin, log = twin_of(), tmp_path / "p.csv"
    log.write_text(RISE)
    values = {p.name: p.prior for p in twin.parameters(["a"])}
    filmed(tmp_path / "a", twin, values, log, count=40)
    assert read_stroke(twin, tmp_path / "a", log, 100.0).film.unused == 8  # of 0.39 s after 0.31 s
    log.write_text("t,p\n5,0\n5.1,9000\n5.2,9000\n")
    with pytest.raises(
        StageError, match=r"times from 5 to 5\.2 s, .* from 0 to 0\.39 s; the film beg"
    ):
        read_stroke(twin, tmp_path / "a", log, 100.0)
    log.write_text("t,p\n-5,0\n-4.9,9000\n-4.8,9000\n")
    with pytest.raises(StageError, match=r"times from -5 to -4\.8 s"):
        read_stroke(twin, tmp_path / "a", log, 100.0)


def test_pictures_of_12_bits_show_the_same_finger(tmp_path):
    """Their grey levels were taken modulo 256."""
    twin, log = twin_of(), tmp_path / "p.csv"
    log.write_text(RISE)
    values = {p.name: p.prior for p in twin.parameters(["a"])}
    filmed(tmp_path / "a", twin, values, log, count=2)
    (tmp_path / "b").mkdir()
    for path in (tmp_path / "a").iterdir():
        deep = 16 * cv2.imread(str(path), cv2.IMREAD_UNCHANGED).astype(np.uint16)
        cv2.imwrite(str(tmp_path / "b" / path.name), deep)
    shallow, deep = (read_stroke(twin, tmp_path / name, log, 100.0).film for name in "ab")
    near = np.abs(shallow.distance) < 20
    assert np.abs(deep.distance - shallow.distance)[near].max() < 1.5  # px, of a noisy edge


@pytest.mark.slow
def test_a_filmed_finger_is_found_again(tmp_path):
    """A rubber 20 % stiffer than the data sheet's; the held-out stroke goes to another pressure."""
    twin, logs = twin_of(), [tmp_path / "a.csv", tmp_path / "b.csv"]
    logs[0].write_text(RISE)
    logs[1].write_text(RISE.replace("15000.0", "20000.0"))
    values = {p.name: p.prior for p in twin.parameters(["a", "b"])}
    values |= {STIFF: 1.2, LOADS: 1.05, LOSS: 0.2, START.format("a"): 0.01, GROWTH: 0.0}
    for name, log in zip("ab", logs, strict=True):
        filmed(tmp_path / name, twin, values, log)
    folder = identify(
        CASES / "single_finger", film=[tmp_path / "a"], hold_out=tmp_path / "b", pressure=logs,
        rate=100.0, scale=MM, root="{:g},{:g}".format(*ROOT), output=tmp_path / "twin",
    )  # fmt: skip
    found = json.loads((folder / "identify.json").read_text())
    by_name = {row["name"]: row for row in found["parameters"]}
    assert by_name[STIFF]["value"] == pytest.approx(1.2, rel=0.02)
    low, high = by_name[LOSS]["band"]
    assert low < 0.2 < high
    assert found["held_out"]["b"]["tip_rms_of_length"] < 0.01
    twin = load_scene(folder, "draft")
    assert twin.structure.loss_factor == pytest.approx(by_name[LOSS]["value"], rel=1e-3)
    assert str(folder / "kinematics" / "states.h5") == str(twin.folder / twin.motion.states)
    assert "predicted within" in (folder / "identify.html").read_text()
    assert len(tip_of(np.zeros((3, 9, 2)))) == 3

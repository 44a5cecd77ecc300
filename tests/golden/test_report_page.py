"""From stage files to the page: what comparison.json says, and the form of report.html."""

import json
import re
import shutil
from html.parser import HTMLParser
from importlib import import_module

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from pipeline.formats.records import FIGURES
from pipeline.runs.run import Run, open_run
from pipeline.runs.stages import BY_NAME
from pipeline.scene.scene import load_scene
from piv.files.record import write_record
from postprocess.compare import stage as compare
from postprocess.draw.style import WIDTH, save
from postprocess.evidence.stage_files import StageFiles
from postprocess.report import (
    assumptions,
    figures,
    flow_figures,
    picture_index,
    time_figures,
    trust,
    wording,
)
from postprocess.report import stage as report
from tests.synthetic_pinch import GAIN, SHIFT, write_pinch
from tests.synthetic_stroke import copy_findings, write_case

LABELS: set[str] = set()
UNIT = re.compile(
    r"(^|, )(s|mm|m/s|°|kPa|Pa|mN|mW|mJ|N/m|cm²/s|cm³/s|cm³/s²|1/s|1|%( of tip speed)?)"
    r"(,? .*)?$"
)
VOID = {"meta", "link", "img", "input", "br", "hr"}


def build(root, write=write_case, **options):
    """A made-up case taken through compare, figures and report with few frames."""
    files = opened(copy_findings(write(root, spacing=0.004, frames=21, **options)))
    run_stages(files)
    return files


def opened(folder):
    """The files of a scene at level coarse."""
    return StageFiles(load_scene(folder, "coarse"))


def run_stage(files, stage, **options):
    """Run a stage as the program does."""
    import_module(BY_NAME[stage].module).run(files.numbers, quiet=True, **options)


def run_stages(files):
    """Compare, figures and report with few frames; keeps the axis labels of every picture."""

    def saved(figure, path):
        LABELS.update(label for ax in figure.axes for label in (ax.get_xlabel(), ax.get_ylabel()))
        return save(figure, path)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flow_figures, "FRAMES", 3)
        patch.setattr(picture_index, "save", saved)
        for stage in ("compare", "figures", "report"):
            run_stage(files, stage)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return build(tmp_path_factory.mktemp("made"))


@pytest.fixture(scope="module")
def pinched(tmp_path_factory):
    return build(tmp_path_factory.mktemp("pinched"), write_pinch)


def result(files):
    return json.loads((files.out / "comparison.json").read_text())


class Page(HTMLParser):
    """Checks that elements nest, and remembers them with their attributes."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.errors = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.errors.append(f"</{tag}> at {self.getpos()}")


def test_the_mean_circulations_are_of_the_instants_at_which_both_are_known(made):
    summary = result(made)["summary"]
    assert summary["cfd"]["instants"] == summary["piv"]["instants"]
    # gain 0.98 with 0.5 % of noise; linear between instants, as below
    ratio = summary["piv"]["circulation_mean"] / summary["cfd"]["circulation_mean"]
    assert ratio == pytest.approx(0.98, abs=0.01)
    remarks = {name: remark for _, name, remark in wording.tiles(result(made), None)}
    assert remarks["tip vortex, CFD"].startswith(f"mean of {summary['cfd']['instants']} instants")
    assert remarks["tip vortex, CFD"].endswith(" side")
    # a mean that goes on after the level's numbers have ended says so
    remarks = {name: remark for _, name, remark in wording.tiles(result(made), 0.2)}
    assert remarks["tip vortex, CFD"].endswith("; the level's numbers end at 0.200 s")


def test_known_differences_come_out_of_the_files(made):
    checks = {c["id"]: c for c in result(made)["checks"]}
    # gain 0.98 with 0.5 % of noise; centres 0.3 mm off with 0.05 mm of noise in x and y; between
    # instants of 20 ms the chord of the vortex path is up to 0.2 mm off its curve
    assert checks["circulation-agrees"]["measured"]["piv-cfd"] == pytest.approx(0.02, abs=0.005)
    assert checks["centre-agrees"]["measured"]["piv-cfd"] == pytest.approx(3e-4, abs=2e-4)
    assert checks["tip-vortex-dorsal"]["measured"] == {"cfd": "dorsal", "piv": "dorsal"}
    assert all(c["met"] is True for c in checks.values())
    table = pd.read_csv(made.out / "comparison.csv")
    middle = table[table["time"].between(*result(made)["middle_of_stroke_s"])]
    ratio = (middle["circulation_piv"] / middle["circulation_cfd"]).mean()
    assert ratio == pytest.approx(0.98, abs=0.01)
    assert result(made)["verdict"]["agrees"] is True


@pytest.mark.parametrize(
    "options, failing",
    [
        ({"gain": 0.9}, {"circulation-agrees"}),
        ({"shift": 3e-3}, {"centre-agrees"}),
        ({"gain": -1.0}, {"circulation-agrees", "tip-vortex-sense"}),
    ],
)
def test_a_wrong_measurement_fails_its_own_checks(tmp_path, options, failing):
    files = opened(copy_findings(write_case(tmp_path, spacing=0.004, frames=21, **options)))
    checks = compare.compare(files)["checks"]
    wrong = {c["id"] for c in checks if c["met"] is False}
    assert wrong == failing, "add a new finding of single_finger to `failing` where it should fail"
    assert wording.answer(result(files)).startswith("Differs: ")


def test_without_a_vortex_in_piv_the_comparison_says_so(tmp_path):
    files = opened(copy_findings(write_case(tmp_path, spacing=0.004, frames=21)))
    table = pd.read_csv(files.out / "vortices_piv.csv", comment="#")
    table[table["track"] == 1].to_csv(files.out / "vortices_piv.csv", index=False)
    checks = {c["id"]: c for c in compare.compare(files)["checks"]}
    assert checks["circulation-agrees"]["met"] is False
    assert "no vortex within" in checks["circulation-agrees"]["notes"][0]
    assert checks["velocity-agrees"]["met"] is True
    assert "is not found in both" in wording.answer(result(files))


@pytest.mark.parametrize("shown, met", [(1, None), (9, True)])
def test_a_circulation_that_missing_vectors_hide_is_undecided(tmp_path, shown, met):
    """Of 20 instants it is known at `shown`; what is hidden is a third too small."""
    files = opened(copy_findings(write_case(tmp_path, spacing=0.004, frames=21)))
    path = files.out / "vortices_piv.csv"
    table = pd.read_csv(path, comment="#")
    vortex = table.index[table["track"] == 3]
    hidden = vortex.delete(np.arange(shown) + 6)
    table.loc[hidden, "circulation"] *= 2 / 3
    table.loc[hidden, "circulation_std"] = 0.3 * table["circulation"].abs()
    head = path.read_text().splitlines()[0]
    path.write_text(f"{head}\n{table.to_csv(index=False)}")
    checks = {c["id"]: c for c in compare.compare(files)["checks"]}
    check, text = checks["circulation-agrees"], wording.answer(result(files))
    assert check["met"] is met
    assert checks["centre-agrees"]["met"] is True
    assert "its centre by" in text if met else "centre of the tip vortex differs by" in text
    counted = f"at {shown} of {shown if met else 17} instants"  # the flow has it at 17
    assert counted in check["notes"][-1]
    assert counted in text
    assert text.startswith("Agrees: " if met else "Undecided in the circulation of the tip")
    remarks = {name: remark for _, name, remark in wording.tiles(result(files), None)}
    assert ("difference of circulation" in remarks) is bool(met)
    assert counted in remarks.get("difference of circulation", counted)


def test_a_page_of_the_flow_alone_judges_nothing_and_shows_no_piv(tmp_path):
    """Though PIV of an earlier run lies in its folder."""
    files = build(tmp_path, top="filmed = false\n")
    comparison = result(files)
    assert (files.out / "piv.h5").exists()
    assert comparison["sources"] == ["cfd"]
    assert (comparison["checks"], comparison["sentences"]) == ([], [])
    assert comparison["verdict"]["agrees"] is None
    page = (files.out / "report.html").read_text()
    text = re.sub(r"data:[^\"']*|<script.*?</script>|<style.*?</style>", "", page, flags=re.S)
    assert "The flow alone, without camera and PIV: nothing is judged." in text
    for word in ("verdict", "Agree", "findings.toml", "What the paper says", "PIV less CFD"):
        assert word not in re.sub("<pre.*?</pre>", "", text, flags=re.S), word
    assert Page(page).errors == []
    assert "tip vortex, CFD" in text
    assert "circulation_cfd" in pd.read_csv(files.out / "comparison.csv")


def test_the_page_is_well_formed_and_accessible(made):
    page = Page((made.out / "report.html").read_text())
    assert page.errors == []
    assert page.open == []
    images = [a for tag, a in page.elements if tag == "img"]
    assert len(images) > 8
    assert all(len(a.get("alt", "")) > 15 for a in images)
    labels = {a.get("for") for tag, a in page.elements if tag == "label"}
    assert {a["id"] for tag, a in page.elements if tag == "input"} <= labels
    assert {"numerics", "power"} <= {a.get("id") for _, a in page.elements}
    ids = [a["id"] for _, a in page.elements if "id" in a]
    assert len(ids) == len(set(ids))
    targets = {a["href"][1:] for tag, a in page.elements if tag == "a"}
    assert targets <= set(ids)
    assert ("html", {"lang": "en"}) in page.elements


def test_the_page_needs_no_network(made):
    text = (made.out / "report.html").read_text()
    rest = re.sub(r"data:[^\"']*", "", text)
    assert not re.search(r"https?://|//[a-z]+\.[a-z]+/|@import|url\(", rest)
    for tag, attrs in Page(text).elements:
        for key in ("src", "srcset", "data", "poster"):
            assert attrs.get(key, "data:").startswith("data:"), f"{tag} {key}"
        assert tag != "link" or attrs["href"].startswith("data:")


def test_the_first_screen_has_the_answer_with_its_numbers(made):
    text = (made.out / "report.html").read_text()
    answer = re.search(r'<p id="answer"[^>]*>([^<]*)<', text).group(1).replace("\u00a0", " ")
    told = r"Agrees: .* differs by \d\.\d % \(allowed 5\.0 %\).*\d\.\d\d mm \(allowed 1\.50 mm\)"
    assert re.match(told, answer)
    assert text.index('id="answer"') < text.index("<nav")


def test_curves_and_film_are_shaded_where_the_numbers_of_the_level_end(made, tmp_path):
    scene = tmp_path / "stroke"
    shutil.copytree(made.scene_folder, scene, symlinks=True)
    files = opened(scene)
    times = pd.read_csv(files.out / "comparison.csv")["time"]
    half, last = float(times.mean()), float(times.iloc[-1])
    results = scene / "studies" / "results"
    results.mkdir(parents=True)
    found = {}
    for late in (0.2, 0.3):
        (results / "errors.csv").write_text(
            "run,start_s,end_s,reference,error_circulation,error_near_tip,error\n"
            f"coarse,0,{half},medium,0.04,0.1,0.1\n"
            f"coarse,{half},{last},medium,0.04,{late},{late}\n"
        )
        run_stage(files, "report")
        text = (files.out / "report.html").read_text()
        page = Page(text)
        assert page.errors == []
        assert "errors" in {a.get("id") for _, a in page.elements}
        shaded = sum(tag == "b" and "style" in a for tag, a in page.elements)
        curves = sum(tag == "figure" and "data-axis" in a for tag, a in page.elements)
        found[late] = shaded, curves, f"numbers end at {half:.3f}" in text
    curves = found[0.3][1]
    assert found == {0.2: (0, curves, False), 0.3: (curves, curves, True)}
    assert curves >= 2


@pytest.mark.parametrize(
    "name, stage",
    [("sheet.h5", "compare"), ("vortices_cfd.csv", "compare"), ("comparison.json", "report")],
)
def test_a_missing_required_input_is_one_sentence(made, tmp_path, name, stage):
    shutil.copytree(made.scene_folder, tmp_path / "single_finger")
    (tmp_path / "single_finger/out/coarse" / name).unlink()
    with pytest.raises(FileNotFoundError, match=f"{name}.*run the stage"):
        run_stage(opened(tmp_path / "single_finger"), stage)


@pytest.mark.parametrize("of, words", [("made", ""), ("pinched", "lie beyond them.")])
def test_pictures_and_rows_say_where_they_lie_beyond_the_levels_numbers(
    of, words, request, monkeypatch
):
    files = request.getfixturevalue(of)
    path, entries = files.out / "report.html", FIGURES.read(files.out / "figures/figures.json")
    times = sorted(entry["time"] for entry in entries["entries"] if "time" in entry)
    before = path.read_text()
    said = "The level's numbers have ended before"
    assert said not in before
    end = times[0]
    monkeypatch.setattr(trust, "level_error", lambda *_: trust.LevelError("It errs.", end=end))
    report.make_report(files)
    page = path.read_text()
    path.write_text(before)  # as other tests know it
    # the picture at the head of the page is one of them again
    assert page.count(said) >= sum(time > end for time in times) > 0
    assert words in page


def test_every_axis_of_every_picture_names_its_unit(made, pinched):
    assert len(LABELS) > 12
    assert [label for label in LABELS if label and not UNIT.search(label.replace("\n", " "))] == []


def test_a_made_up_pinch_is_judged_by_its_pair(pinched):
    checks = {c["id"]: c for c in result(pinched)["checks"]}
    # of PIV alone: a symmetry plane makes the CFD's so
    assert checks["pair-opposite"]["measured"] == {"piv": "opposite"}
    imbalance = checks["pair-equal"]["measured"]
    assert imbalance["piv"] == pytest.approx(2 * (1 - GAIN) / (1 + GAIN), rel=1e-3)
    assert checks["pair-mirrored"]["measured"]["piv"] == pytest.approx(SHIFT, rel=1e-3)
    assert checks["pair-ventral"]["met"] is False  # made on the dorsal side
    assert checks["contact-dorsal"]["window"] == "-0.005 to +0.02 s from contact"
    assert checks["ventral-pair-approaching"]["measured"]["cfd"] == 0.0  # has none
    sentences = {entry["quote"][:20]: entry["verdict"] for entry in result(pinched)["sentences"]}
    assert sentences["Hence the vortexes i"] == "met"
    assert sentences["The flows between tw"] == "not testable"


def test_what_needs_the_single_finger_is_not_judged_without_it(pinched):
    check = next(c for c in result(pinched)["checks"] if c["id"] == "pair-forward")
    assert check["met"] is None
    told = "the single finger at level coarse was not run as it is, so nothing is compared with it"
    assert check["notes"] == [f"{told}: make single_finger LEVEL=coarse"]


def test_the_page_of_a_pinch_shows_both_fingers(pinched):
    text = (pinched.out / "report.html").read_text()
    assert "RMS of |Γ0 + Γ1|" in text  # a symbol stays as it is
    page = Page(text)
    assert page.errors == []
    assert "pinch" in {attrs.get("id") for tag, attrs in page.elements if tag == "section"}
    told = {"stop 0.5", "make single_finger LEVEL=coarse", "left finger"}
    assert {words for words in told | {"second: (a)"} if words not in text} == set()
    for source in ("cfd", "piv"):
        pairs = pd.read_csv(pinched.out / f"pairs_{source}.csv")
        assert (pairs["circulation_0"] < 0).all()
        lines = pd.read_csv(pinched.out / f"centreline_{source}.csv")
        assert len(lines) > 10


def test_pictures_for_print_and_one_table_of_all_series(made):
    folder = figures.print_figures(made)
    names = {path.name for path in folder.iterdir()}
    assert {"timeline.pdf", "timeline.png", "flow_0.pdf", "flow_0.png", "series.csv"} <= names
    assert {name.rpartition(".")[0] for name in names if name.endswith(".pdf")} == {
        name.rpartition(".")[0] for name in names if name.endswith(".png")
    }
    with Image.open(folder / "timeline.png") as picture:
        assert picture.info["dpi"] == pytest.approx((300, 300), abs=0.1)
        assert picture.width == pytest.approx(300 * WIDTH, abs=2)
    table = pd.read_csv(folder / "series.csv")
    assert list(table.columns[:6]) == [
        "time_s", "pressure_Pa", "bend_deg", "tip_x_m", "tip_y_m", "force_x_N",
    ]  # fmt: skip
    assert table["bend_deg"].iloc[-1] == pytest.approx(100, abs=1)  # of the made-up stroke
    assert table["pressure_Pa"].max() == pytest.approx(20e3, rel=0.05)
    seen = table["circulation_piv_m2_per_s"] / table["circulation_cfd_m2_per_s"]
    assert seen.median() == pytest.approx(0.98, abs=0.01)  # its gain


def test_the_page_names_pressure_and_strokes(made):
    scene = made.numbers.model_copy(update={"actuator": {"chambers": 6, "material": "Ecoflex"}})
    text = dict(assumptions.statements(scene, 0.3, 0.1))["Actuator"]
    assert text.startswith("6 chambers, 70 × 28 mm; Ecoflex")
    assert "pressure: to 20 kPa in 0.3 s from 0.02 s." in text
    layers = {"upper": {"name": "A"}, "lower": {"law": "yeoh"}}
    motion = scene.motion.model_copy(update={"pressure_csv": "p.csv", "strokes": ()})
    scene = scene.model_copy(update={"actuator": {"materials": layers}, "motion": motion})
    text = dict(assumptions.statements(scene, 0.3, 0.1))["Actuator"]
    assert "upper layer of A, lower layer of yeoh" in text
    assert text.endswith("pressure: p.csv.")


def test_processes_change_no_picture(made, tmp_path):
    shutil.copytree(made.scene_folder.parent, tmp_path / "cases")
    files = opened(tmp_path / "cases" / made.scene)
    pictures = [f.relative_to(made.figures) for f in made.figures.rglob("*") if f.is_file()]
    # the report draws what all has cost
    drawn = [f for f in pictures if f.name != "costs.svg" and f.name[0] != "."]
    for name in drawn:
        (files.figures / name).unlink()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flow_figures, "FRAMES", 3)
        run_stage(files, "figures", threads=2)
    assert {"timeline.svg", "figures.json", "flow_0.webp"} < {f.name for f in drawn}
    folders = files.figures, made.figures
    one, other = ([(folder / name).read_bytes() for name in drawn] for folder in folders)
    assert one == other


def test_levels_that_are_not_stale_are_drawn_together(made, tmp_path, monkeypatch):
    shutil.copytree(made.scene_folder.parent, tmp_path / "cases")
    shutil.copytree(made.out, tmp_path / "cases" / made.scene / "out" / "medium")
    files = opened(tmp_path / "cases" / made.scene)
    scene = files.scene_folder / "scene.toml"
    scene.write_text(f"{scene.read_text()}\n[levels.medium]\n")
    names = []
    for why in (None, "mesh.tip_cell changed"):
        monkeypatch.setattr(Run, "why_stale", lambda run, stage, why=why: why)
        figures._draw(files, lambda album, flow: _level_names(names, album, flow))
    assert names == [["paths.svg", "levels.svg"], ["paths.svg"]]


def _level_names(names, album, flow):
    time_figures.vortex_figures(album, flow)
    names.append([entry["file"] for entry in album.entries])


def test_the_single_finger_beside_is_compared_at_equal_bend(pinched, tmp_path):
    """The synthetic single finger equals the left finger: the only shift is PIV error."""
    shutil.copytree(pinched.scene_folder.parent, tmp_path / "cases")
    write_case(tmp_path, "single_finger", bend_end=np.radians(80), spacing=0.004, frames=21)
    files = opened(tmp_path / "cases" / "pinch")
    alone = open_run(tmp_path / "cases" / "single_finger")

    def measured(digest):
        for stage in ("sheet", "vortices_cfd"):
            about = {"made_from": {}, "digest": digest or alone.digest(stage)}
            write_record(alone.out, stage, about, [alone.path(stage)])
        run_stage(files, "compare")
        return next(c for c in result(files)["checks"] if c["id"] == "pair-forward")

    own = measured(None)
    assert own["measured"]["cfd"] == pytest.approx(0.0, abs=1e-9)
    assert own["met"] is False
    assert measured("that of another scene")["measured"]["cfd"] is None


def test_a_scene_without_findings_is_judged_by_agreement_and_says_so(tmp_path):
    files = opened(write_case(tmp_path, spacing=0.004, frames=21))
    run_stages(files)
    comparison = result(files)
    assert {c["kind"] for c in comparison["checks"]} == {"agreement"}
    assert comparison["verdict"]["agrees"] is True
    text = (files.out / "report.html").read_text()
    assert Page(text).errors == []
    assert "The scene has no findings (reference/findings.toml)" in text
    assert "the paper's 0" not in text
    assert "What the paper saw" not in text

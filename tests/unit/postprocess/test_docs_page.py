"""A scene's page of the docs: its sections written by hand outlive `make docs`."""

from argparse import Namespace
from pathlib import Path

from postprocess.report import docs_page

ROOT = Path(__file__).parents[3]
RUN = {
    "scene_hash": "0", "versions": {}, "cells": 1, "model": "2d", "steps": 1, "time_step": 1e-3, "ranks": 1, "wall_time": 1.0,
    "courant_max": 1.0, "power_balance": {},
}  # fmt: skip


def test_sections_written_by_hand_are_taken_in(monkeypatch):
    monkeypatch.setattr(docs_page, "balance_sentence", lambda balance: "")
    monkeypatch.setattr(docs_page, "power_table", lambda balance: "")
    comparison = {"verdict": {"counts": {}}, "checks": [], "summary": {}, "sentences": []}
    words = "## By hand\n\nAs it is.\n"
    text = docs_page.page("pinch", "smoke", comparison, RUN, "pinch.png", words)
    assert f"`.\n\n{words}\n**The run.**" in text
    assert text.replace(f"\n{words}", "") == docs_page.page(
        "pinch", "smoke", comparison, RUN, "pinch.png"
    )


def test_a_page_of_another_level_does_not_replace_the_default_ones(monkeypatch, tmp_path):
    monkeypatch.setattr(docs_page, "page", lambda scene, level, *rest: f"{level} {rest[2]}")
    for level in ("coarse", "medium"):
        out = tmp_path / "pinch" / "out" / level
        for folder in ("figures", "run"):
            (out / folder).mkdir(parents=True)
        for name in ("flow_0.png", "pair.svg"):
            (out / "figures" / name).write_text(level)
        docs_page.COMPARISON.write(out / "comparison.json", {})
        docs_page.RUN.write(out / "run" / "run.json", {})
        docs_page.run(Namespace(scene=tmp_path / "pinch", level=level, docs=tmp_path))
    found = {path.name: path.read_text() for path in tmp_path.iterdir() if path.is_file()}
    assert found == {
        "pinch.md": "coarse pinch.png",
        "pinch.png": "coarse",
        "pinch_pair.svg": "coarse",
        "pinch_medium.md": "medium pinch_medium.png",
        "pinch_medium.png": "medium",
        "pinch_medium_pair.svg": "medium",
    }


def test_the_page_of_the_pinch_has_them():
    words = (ROOT / "cases" / "pinch" / "reference" / "words.md").read_text(encoding="utf-8")
    assert words in (ROOT / "docs" / "pinch.md").read_text(encoding="utf-8")

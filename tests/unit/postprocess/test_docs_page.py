"""A scene's page of the docs: its sections written by hand outlive `make docs`."""

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
    assert text.replace(f"\n{words}", "") == docs_page.page("pinch", "smoke", comparison, RUN, "pinch.png")


def test_the_page_of_the_pinch_has_them():
    words = (ROOT / "cases" / "pinch" / "reference" / "words.md").read_text(encoding="utf-8")
    assert words in (ROOT / "docs" / "pinch.md").read_text(encoding="utf-8")

"""What a scene inherits: tables are merged entry by entry, a law's parameters go with their law."""

from __future__ import annotations

from pipeline.scene.read_toml import merge


def test_tables_are_merged_entry_by_entry():
    assert merge({"a": {"b": 1, "c": 2}}, {"a": {"c": 3}}) == {"a": {"b": 1, "c": 3}}


def test_parameters_of_another_law_replace_those_of_the_first():
    base = {"upper": {"law": "mooney_rivlin", "bulk": 2.0, "parameters": {"C10": 1.0, "C01": 2.0}}}
    over = {"upper": {"law": "yeoh", "parameters": {"C10": 3.0, "C20": 4.0, "C30": 5.0}}}
    assert merge(base, over)["upper"] == {
        "law": "yeoh", "bulk": 2.0, "parameters": {"C10": 3.0, "C20": 4.0, "C30": 5.0},
    }  # fmt: skip

"""The references of scene.toml and dpiv.toml follow from the models, as do all complaints."""

import tomllib

import pytest

from docs.evidence.reference import FOLDER, PAGES
from pipeline.scene.key_reference import MISSING
from piv.files.errors import StageError
from postprocess.lab.dpiv_toml import KEYS as DPIV_KEYS
from postprocess.lab.dpiv_toml import dpiv_template, read_dpiv
from softfinger import scene_reference
from tests.conftest import write_scene

KEYS = [*scene_reference.keys(), *DPIV_KEYS]
TEMPLATES = scene_reference.scene_template(), dpiv_template(None)


@pytest.mark.parametrize("name", PAGES)
def test_the_page_is_what_the_models_say(name):
    written = (FOLDER / name).read_text(encoding="utf-8")
    assert written == PAGES[name](), "run: python -m docs.evidence.reference"


@pytest.mark.parametrize("key", KEYS, ids=lambda key: key.name)
def test_every_key_has_a_meaning_and_every_number_but_a_count_a_unit(key):
    assert key.meaning
    if "number" in key.type and "whole" not in key.type:
        assert key.unit, f"{key.name}: add its unit in brackets to its docstring; [1]: none"


@pytest.mark.parametrize("text", TEMPLATES)
def test_a_template_filled_in_is_valid_toml_and_asks_for_what_is_required(text):
    table = tomllib.loads(text.replace("= …", "= 0"))
    wanted = [key.name for key in KEYS if key.default == MISSING and "." not in key.name]
    assert set(table) & set(wanted)
    opened = "\n".join(line.removeprefix("# ") for line in text.splitlines())
    assert tomllib.loads(opened.replace("= …", "= 0"))


def test_all_that_is_wrong_in_a_scene_is_told_at_once_with_the_nearest_spelling(tmp_path):
    more = f"[camera]\nscale_mm_px = 0.1\n[piv]\nwindows = 32\nspacing = -1\n{'a' * 3000} = 1"
    with pytest.raises(StageError) as caught:
        write_scene(tmp_path / "s", more=more)
    text = str(caught.value)
    assert "camera.scale_mm_px: this key is not known; did you mean scale_mm_per_px?" in text
    assert "piv.windows: this key is not known; did you mean window?" in text
    assert "piv.spacing: " in text
    assert "\n" not in text
    assert len(text) < 700  # a name of any length is cut


def test_all_that_is_wrong_in_a_dpiv_toml_is_told_at_once(tmp_path):
    (tmp_path / "dpiv.toml").write_text(
        'format = "dpiv"\nformat_version = 4\ntitel = "a"\nkind = "pictures"\n'
    )
    with pytest.raises(ValueError, match="title is missing") as caught:
        read_dpiv(tmp_path)
    text = str(caught.value)
    assert "titel: this key is not known; did you mean title?" in text
    for key in ("files", "scale.std_percent", "axes.y", "piv.window", "frame_rate_hz"):
        assert f"{key} is missing: " in text

"""TOML that people write: what is wrong with it is one sentence that names the file and the key."""

import pytest

from pipeline.scene.key_reference import template
from pipeline.scene.toml_text import read_toml
from piv.files.errors import StageError
from softfinger.scene_reference import keys

TABLES = "a = 1\n[finger]\nroot =  # m\nlength = 0.07\n[[motion.strokes]]\nstart = …\n"


@pytest.mark.parametrize(
    "content, told",
    [
        (TABLES, "no value is given for finger.root, motion.strokes.start; give one, or take"),
        (template(keys()), "no value is given for title, finger.root"),
        *((text, "not valid TOML: ") for text in ("a = [1, 2", "nonsense", "a = " + "[" * 100_000)),
        (b"a = \xff", "not valid TOML: "),
    ],
)
def test_what_is_no_toml_is_one_sentence(tmp_path, content, told):
    path = tmp_path / "scene.toml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(StageError) as caught:
        read_toml(path)
    assert str(caught.value).startswith(f"{path}: {told}")
    assert "\n" not in str(caught.value)


def test_what_is_toml_is_read(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text("a = 1\n[b]\nc = '='")
    assert read_toml(path) == {"a": 1, "b": {"c": "="}}

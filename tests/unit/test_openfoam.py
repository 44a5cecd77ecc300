"""OpenFOAM's environment."""

import pytest

from pipeline import openfoam
from pipeline.errors import StageError


def test_a_path_with_a_space_is_refused_in_one_sentence(tmp_path, monkeypatch):
    monkeypatch.setattr(openfoam, "environment", lambda: {"A": "1"})
    assert openfoam.environment_in(tmp_path) == {"A": "1", "PWD": str(tmp_path.resolve())}
    with pytest.raises(StageError, match="no path with a space"):
        openfoam.environment_in(tmp_path / "my project")

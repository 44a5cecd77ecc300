"""Fields in OpenFOAM's files: written into the base case's templates, read back."""

import numpy as np
import pytest

from pipeline.openfoam.foamfile import is_complete, read_field, write_field
from piv.files.errors import StageError
from tests.conftest import CASES


@pytest.mark.parametrize("name, shape", [("p", (7,)), ("U", (7, 3))])
def test_a_field_is_written_into_its_template_and_read_back(tmp_path, name, shape):
    template, path = CASES / "_base" / "0" / name, tmp_path / "0.25" / name
    values = np.random.default_rng(1).normal(size=shape)
    write_field(path, template, values)
    assert (read_field(path, 7) == values).all()
    assert is_complete(path)
    assert template.read_bytes().partition(b"boundaryField")[2].strip() in path.read_bytes()
    uniform = read_field(template, 7)
    assert uniform.shape == shape
    assert not uniform.any()


def test_another_file_is_refused(tmp_path):
    (tmp_path / "nonsense").write_text("nonsense")
    with pytest.raises(StageError, match="not an OpenFOAM field"):
        read_field(tmp_path / "nonsense", 7)

"""What is left of an earlier registration where a fit is refused."""

from types import SimpleNamespace

import numpy as np
import pytest

from fileio.errors import StageError
from postprocess.lab.registration.check_fit import FitCheck
from postprocess.lab.registration.step import refuse_what_does_not_fit


@pytest.mark.parametrize("quick", [True, False])
def test_a_quick_look_leaves_the_registration(tmp_path, quick):
    names = {"registration": "registration.json", "refused": "refused.png"}
    files = SimpleNamespace(**{key: tmp_path / name for key, name in names.items()})
    files.registration.write_text("{}")
    square = np.array([[1.0, 1.0], [6.0, 1.0], [6.0, 6.0], [1.0, 6.0]])
    check = FitCheck(["it is askew"], np.ones((8, 8)), square, np.zeros(4, bool))
    message = r"dpiv\.toml: the registration is refused: it is askew; see .*refused\.png"
    with pytest.raises(StageError, match=message):
        refuse_what_does_not_fit(files, check, SimpleNamespace(folder=tmp_path), keep=quick)
    assert files.registration.exists() == quick
    assert files.refused.exists()

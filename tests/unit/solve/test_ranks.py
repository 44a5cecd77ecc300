"""Where the files of the ranks lie."""

import numpy as np
import pytest

from pipeline.openfoam.case_folder import Case
from pipeline.openfoam.foamfile import binary_list, header, labels_of, write_bytes
from piv.files.errors import StageError


def test_labels_of_each_rank(tmp_path):
    """As decomposePar writes them: with a header in each file."""
    case, lists = Case(tmp_path, 2), [np.arange(5), np.array([7, 9])]
    head = header("labelList", "", "pointProcAddressing", binary=True)
    name = "constant/polyMesh/pointProcAddressing"
    for rank, labels in enumerate(lists):
        write_bytes(tmp_path / f"processor{rank}" / name, head + binary_list(labels))
    arrays = [labels_of(content) for content in case.contents(name)]
    for labels, wanted in zip(arrays, lists, strict=True):
        np.testing.assert_array_equal(labels, wanted)


def test_a_missing_rank_is_named(tmp_path):
    with pytest.raises(StageError, match="missing"):
        Case(tmp_path, 2).contents("0/U")

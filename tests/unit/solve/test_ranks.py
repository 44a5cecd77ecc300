"""Where the ranks' files lie, and files that hold a block of each."""

import numpy as np
import pytest

from pipeline.openfoam.case_folder import Case, collated_content, read_blocks
from pipeline.openfoam.foamfile import binary_list, header, labels_of, write_bytes
from piv.files.errors import StageError


def test_folders(tmp_path):
    assert Case(tmp_path).folders == [tmp_path]
    assert [f.name for f in Case(tmp_path, 2).folders] == ["processor0", "processor1"]
    assert [f.name for f in Case(tmp_path, 64, collated=True).folders] == ["processors64"]


def test_blocks_are_read_back_whatever_is_in_them():
    blocks = [b"// Processor1\n\n3\n(abc)", b"", b"))(\n" * 50, bytes(range(256))]
    assert read_blocks(collated_content("U", blocks)) == blocks


def test_a_cut_file_is_not_whole(tmp_path):
    content = collated_content("U", [b"abc", b"defg"])
    path = tmp_path / "U"
    for end in range(len(content) - 20, len(content) + 1):
        path.write_bytes(content[:end])
        # the last byte is a line's end
        assert Case(tmp_path, 2, collated=True).is_whole(path) == (end >= len(content) - 1), end


def test_blocks_of_later_versions_are_named_with_a_small_letter():
    content = collated_content("points", [b"abc", b"// Processor1"])
    later = content.replace(b"\n// Processor", b"\n// processor")
    assert read_blocks(later) == read_blocks(content)


@pytest.mark.parametrize("collated", [False, True])
def test_labels_of_each_rank(tmp_path, collated):
    """As decomposePar writes them: with a header in each file, or in the first block only."""
    case, lists = Case(tmp_path, 2, collated), [np.arange(5), np.array([7, 9])]
    head = header("labelList", "", "pointProcAddressing", binary=True)
    name = "constant/polyMesh/pointProcAddressing"
    if collated:
        blocks = [head + binary_list(lists[0]), b"\n" + binary_list(lists[1])]
        content = collated_content("pointProcAddressing", blocks)
        write_bytes(tmp_path / "processors2" / name, content)
    else:
        for rank, labels in enumerate(lists):
            write_bytes(tmp_path / f"processor{rank}" / name, head + binary_list(labels))
    arrays = [labels_of(content) for content in case.contents(name)]
    for labels, wanted in zip(arrays, lists, strict=True):
        np.testing.assert_array_equal(labels, wanted)


def test_the_past_of_the_mesh_is_announced_to_each_rank_where_it_is_saved_and_withdrawn(tmp_path):
    case = Case(tmp_path, 2, collated=True)
    write_bytes(tmp_path / "processors2" / "0.02" / "V0", collated_content("V0", [b"a", b"b"]))
    case.announce("0.02")
    laid = sorted(str(p.relative_to(tmp_path)) for p in tmp_path.glob("processor[0-9]*/*/*"))
    assert laid == ["processor0/0.02/V0", "processor1/0.02/V0"]  # no meshPhi: it was not saved
    case.withdraw()
    assert [p.name for p in tmp_path.iterdir()] == ["processors2"]
    Case(tmp_path, 2).announce("0.02")
    assert [p.name for p in tmp_path.iterdir()] == ["processors2"]


def test_too_few_ranks_are_named(tmp_path):
    write_bytes(tmp_path / "processors3" / "0" / "U", collated_content("U", [b"a", b"b"]))
    with pytest.raises(StageError, match="2 of 3 ranks"):
        Case(tmp_path, 3, collated=True).contents("0/U")
    with pytest.raises(StageError, match="missing"):
        Case(tmp_path, 2).contents("0/U")

"""Tables and JSON records: other versions and kinds are refused."""

import json

import numpy as np
import pytest

from pipeline.formats.records import FORCES, RECORDS
from piv.files.errors import StageError
from piv.formats.vortex_table import read_vortices


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: r.format)
def test_a_record_of_another_version_is_refused_with_what_to_do(tmp_path, record):
    path = tmp_path / "a.json"
    record.write(path, {"value": 1.5})
    assert record.read(path)["value"] == 1.5
    for version in (record.version - 1, record.version + 1):
        path.write_text(json.dumps({"format": record.format, "format_version": version}))
        words = f"of this {record.format} file is {version}, this program reads {record.version}; "
        with pytest.raises(StageError, match=f"a.json: format_version {words}.*again$"):
            record.read(path)
    path.write_text("{}")
    with pytest.raises(StageError, match=f"a.json: format is None, not '{record.format}'; .*again"):
        record.read(path)


def test_a_table_comes_back_to_the_last_digit_written(tmp_path):
    rows = [[k / 3 for k in range(8)], [0.1 * k for k in range(8)]]
    FORCES.write(tmp_path / "a.csv", rows)
    np.testing.assert_allclose(FORCES.read(tmp_path / "a.csv"), rows, rtol=1e-11)


def test_no_table_is_one_sentence(tmp_path):
    path = tmp_path / "a.csv"
    wrong = {None: "missing", "": "not a readable", "time,fx\n0,1\n": "column 'fy'"}
    for text, words in wrong.items():
        if text is not None:
            path.write_text(text)
        with pytest.raises(StageError, match=rf"a\.csv: {words}.*; delete it and run make again$"):
            FORCES.read(path)
    path.write_text('# {"format": "vortices", "format_version": 99}\ntime,x\n')
    with pytest.raises(StageError, match="find the vortices again"):
        read_vortices(path)

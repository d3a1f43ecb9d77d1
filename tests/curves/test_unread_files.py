"""Files of a folder that hold records which no device reads: a row each, with what to do."""

import json

import numpy as np
import pytest
from palpate import LogError
from palpate_kit.logs.draft_pipeline import UNREAD, recording_of


@pytest.mark.parametrize("ending", UNREAD)
def test_a_format_that_nothing_reads_says_what_to_do(tmp_path, ending):
    path = tmp_path / f"record{ending.upper()}"
    path.write_bytes(b"\0\1\2")
    with pytest.raises(LogError, match=f"no device reads \\{ending} files: "):
        recording_of(path)


def test_a_file_that_cannot_be_read_is_a_row(palpate, tmp_path):
    """It was in no row and in no count."""
    (tmp_path / "old.xls").write_bytes(b"\xd0\xcf\x11\xe0")
    time = np.arange(200) / 100.0
    height = 1.0 - 2.0 * np.clip(time - 0.5, 0.0, 1.0)
    force = 0.5 * np.maximum(-height, 0.0) ** 1.5 + 1e-3 * np.random.default_rng(0).standard_normal(200)
    rows = "".join(f"{t:.3f},{z:.5f},{f:.5f}\n" for t, z, f in zip(time, height, force, strict=True))
    (tmp_path / "press.csv").write_text("time (s),height (mm),force (N)\n" + rows)
    found = palpate("fit", str(tmp_path), "--tip", "paraboloid 3 mm", "--json", "-o", str(tmp_path / "fit"))
    rows = {row["curve"].rpartition("/")[2]: row for row in json.loads(found.stdout)["files"]}
    assert set(rows) == {"old.xls", "press.csv"}
    assert "save it as .xlsx" in rows["old.xls"]["error"]
    assert found.returncode == 1

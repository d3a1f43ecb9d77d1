"""Many files are looked at by several processes, and read as by one."""

import numpy as np
import pytest
from palpate_engine import RigFacts
from palpate_fits import file_pipelines
from palpate_fits.file_pipelines import file_groups
from palpate_kit.curves.alike_logs import LogPart
from palpate_kit.curves.file_facts import FileFacts
from palpate_kit.curves.stated_facts import StatedFacts

from tests.curves.conftest import press


@pytest.fixture
def files(tmp_path):
    """Presses with and without names, and one that cannot be read."""
    heads = ["time_s,force_N,height_mm", "time (s),Force (N),z (mm)"]
    for number in range(5):
        table = press(number, n=300)
        path = tmp_path / f"{number}.csv"
        np.savetxt(path, table, delimiter=",", header=heads[number % 2], comments="", fmt="%.9g")
    (tmp_path / "empty.csv").write_text("a,b\n")
    return [LogPart(path) for path in sorted(tmp_path.iterdir())]


def groups(files, jobs):
    facts = FileFacts(StatedFacts(RigFacts(tip="paraboloid 3 mm"), files[0].path))
    found = file_groups(files, facts, {}, {}, jobs)
    return [(group.text, group.doubts, group.curves) for group in found.read], found.refused, found.questions


@pytest.mark.slow
def test_several_processes_read_files_as_one_does(files, monkeypatch):
    alone = groups(files, 1)
    monkeypatch.setattr(file_pipelines, "_MANY", len(files))
    assert groups(files, 2) == alone
    assert len(alone[0]) == 2
    assert list(alone[1]) == [str(files[-1])]


def test_few_files_and_one_job_need_no_process(monkeypatch):
    monkeypatch.setattr(file_pipelines, "core_count", lambda: 4)
    many = file_pipelines._MANY
    assert [file_pipelines.worker_count(count, None) for count in (1, many - 1, many)] == [1, 1, 4]
    assert file_pipelines.worker_count(many, 1) == 1

"""The folder that a run is given: one run writes there, whatever begins at the same instant."""

import threading
from datetime import UTC, datetime

import pytest
from palpate import OutputError
from palpate_engine.result.result_folder import make_folder

NOW = datetime(2026, 1, 1, tzinfo=UTC)


@pytest.mark.parametrize("there", [False, True])
def test_of_runs_that_begin_at_once_one_gets_the_folder(tmp_path, there):
    """None has written anything yet."""
    wanted, ready, got, refused = tmp_path / "out", threading.Barrier(8), [], []
    if there:
        wanted.mkdir()

    def begin():
        ready.wait()
        try:
            got.append(make_folder("run", wanted, NOW))
        except OutputError as error:
            refused.append(str(error))

    threads = [threading.Thread(target=begin) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert got == [wanted]
    assert refused == [f"{wanted}: another run has just begun to write there"] * 7


def test_a_folder_that_holds_something_is_not_taken(tmp_path):
    (tmp_path / "note.txt").write_text("mine")
    with pytest.raises(OutputError, match="the output folder is not empty, and nothing is ever overwritten"):
        make_folder("run", tmp_path, NOW)


def test_many_runs_of_one_process_keep_few_folders_open(tmp_path):
    before = len(list((tmp_path.parents[-1] / "proc/self/fd").iterdir()))
    for i in range(100):
        make_folder("run", tmp_path / f"{i}", NOW)
    assert len(list((tmp_path.parents[-1] / "proc/self/fd").iterdir())) < before + 20

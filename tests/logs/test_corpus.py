"""Files with one thing wrong: what is asked of them is answered, or refused in words, in bounded memory and time."""

import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from palpate import UserError
from palpate_devices.mcap_replay import McapReplay
from palpate_logs.commands.export import export
from palpate_logs.commands.info import recording_of

CORPUS = Path(__file__).parent / "corpus"
FILES = sorted(path.name for path in CORPUS.iterdir() if path.suffix != ".md")
READABLE = {  # what is wrong with these leaves all of their numbers as they were
    *("index_points_nowhere.mcap", "index_points_into_a_message.mcap", "index_claims_too_many.mcap"),
    *("attachment_without_end.mcap",),
}


def peak():
    """The most memory [kB] that this process ever had."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1])


def refused(ask):
    """The words with which a reader refuses; None where it does not."""
    try:
        ask()
    except UserError as refusal:
        return str(refusal)
    return None


SLOW = ("pages_of_noise.db3", "chunk_claims_100_gb.mcap")


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW or "bomb" in name else []) for name in FILES]
)
def test_whatever_is_asked_of_it(tmp_path, name):
    path = Path(shutil.copy(CORPUS / name, tmp_path))
    before, began = peak(), time.process_time()
    reader = recording_of(path)
    for ask in (
        lambda: reader.survey(path),
        lambda: reader.suggest(path, {}),
        lambda: list(reader.tables(path)),
        lambda: export(path, tmp_path / "x.csv", None),
        lambda: reader.recover(path, tmp_path / f"good{path.suffix}"),
    ):
        words = refused(ask)
        assert words is None or (name in words and len(words) < 1000)
    assert peak() - before < 600_000
    assert time.process_time() - began < 30  # of work, however busy the machine is


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith(".mcap")])
@pytest.mark.parametrize("accept_cut", [False, True])
def test_no_number_is_made_up(name, accept_cut):
    signals = {"force": {"topic": "/ft/wrench", "field": "wrench.force.z", "unit": "N"}}
    device = McapReplay.model_validate(
        {"file": CORPUS / name, "signals": signals, "time": "log", "accept_cut": accept_cut}
    )
    batches = []

    def read():
        with device.connect(0) as link:
            batches.extend(link.batches())

    words = refused(read)
    if words is not None:
        assert name in words
        assert name not in READABLE
        return
    time_of, force = (
        np.concatenate([np.zeros(0), *(column(batch) for batch in batches)])
        for column in (lambda b: b.time, lambda b: b.values[:, 0])
    )
    np.testing.assert_array_equal(force, time_of)
    assert len(force) == 40 or accept_cut

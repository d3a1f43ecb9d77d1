"""Lines below a table: they end it, and are said; what goes on after them is refused as before."""

import numpy as np
import pytest
from palpate import LogError
from palpate_logs.csv_replay import CsvReplay
from palpate_logs.csv_roles import suggest_csv

from tests.logs.table_kinds import plain, press, table

PLAIN = table(plain(press(1)))
COUNT = PLAIN.count("\n") - 1
FOOTERS = {
    "a result": ("Maximum force, 0.44\n", "'Maximum force, 0.44'"),
    "its end": ("END\n", "'END'"),
    "a mean": ("mean,1.2,0.3\n", "'mean, 1.2, 0.3'"),
    "an empty line and a summary": ("\nMax,0.44\nMin,0.01,-2\n\nOperator,A. B.\n", "'Max, 0.44' and 2 more below it"),
    "an empty line and a number": ("\n0.44\n", "'0.44'"),
    "without an end of line": ("END", "'END'"),
}


def device(path, rate=None):
    choices = {"rate": rate} if rate else {}
    suggestion = suggest_csv(path, choices)
    return CsvReplay.model_validate({k: v for k, v in suggestion.device.items() if k != "type"}), suggestion.doubts


def readings(log):
    with log.connect(0) as link:
        return np.concatenate([batch.values for batch in link.batches()])


@pytest.mark.parametrize("kind", FOOTERS)
@pytest.mark.parametrize("separator", [",", ";"])
def test_a_footer_ends_the_table_and_is_said(tmp_path, kind, separator):
    """All of them were refused with their line, or taken for a file that was cut."""
    footer, words = FOOTERS[kind]
    path = tmp_path / "a.csv"
    path.write_text((PLAIN + footer).replace(",", separator))
    log, doubts = device(path)
    assert len(readings(log)) == COUNT
    assert any(words in text for text in doubts)
    assert any(words in text for text in log.warnings)
    path.write_text(PLAIN)
    log, doubts = device(path)
    assert len(readings(log)) == COUNT
    assert not log.warnings
    assert not any("the table ends" in text for text in doubts)


def test_words_alone_between_readings_are_no_footer_and_no_loss(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(f"{PLAIN}lost connection\n9.5,0.1,1.0\n")
    log, doubts = device(path)
    assert len(readings(log)) == COUNT + 1
    assert any("passed over: 'lost connection'" in text for text in doubts)
    assert any("passed over: 'lost connection'" in text for text in log.warnings)


@pytest.mark.parametrize("words", ["mean,1.2,0.3", "\nMax,0.44,"])
def test_readings_below_words_are_no_footer(tmp_path, words):
    path = tmp_path / "a.csv"
    path.write_text(f"{PLAIN}{words}\n9.5,0.1,1.0\n")
    log, _ = device(path)
    with pytest.raises(LogError, match=rf"a\.csv:40[23]: .*{words.strip().split(',')[0]}"):
        readings(log)


def test_a_last_line_that_is_cut_is_no_footer(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(PLAIN + "9.5,0.1\n")
    log, _ = device(path)
    with pytest.raises(LogError, match="no column 2; the line has 2"):
        readings(log)


def test_readings_that_are_missing_are_no_footer(tmp_path):
    """Marks of overload and empty cells, the last rows among them."""
    path = tmp_path / "a.csv"
    path.write_text(PLAIN + "9.5,OVER,1.0\n9.6,,1.0\n9.7,***,\n")
    log, _ = device(path)
    assert len(readings(log)) == COUNT + 3
    assert log.warnings == ("a.csv: 2 cells hold a mark of overload, and no reading",)

"""Units behind the numbers in the cells, of every row its own where an instrument changes its range."""

import numpy as np
import pytest
from palpate import LogError
from palpate_logs.csv_replay import CsvReplay
from palpate_logs.csv_roles import suggest_csv

from tests.logs.table_kinds import press

PRESS = press(1)
NAMES = "time,force,height\n"


def rows(form, count=400):
    return "".join(form(t, f, 1e3 * z) + "\n" for t, f, z in zip(PRESS.t[:count], PRESS.f, PRESS.z))


def ranging(t, f, z):
    """A force that is written in mN below 100 mN."""
    force = f"{1e3 * f:.4f} mN" if abs(f) < 0.1 else f"{f:.7f} N"
    return f"{t:.3f} s,{force},{z:.6f} mm"


FORMS = {
    "with a space": (",", lambda t, f, z: f"{t:.3f} s,{f:.7f} N,{z:.6f} mm"),
    "without one": (",", lambda t, f, z: f"{t:.3f}s,{f:.7f}N,{z:.6f}mm"),
    "with changes of range": (",", ranging),
    "with decimal commas": (";", lambda t, f, z: f"{t:.3f} s;{f:.7f} N;{z:.6f} mm".replace(".", ",")),
    "of the force alone": (",", lambda t, f, z: f"{t:.3f},{f:.7f} N,{z:.6f}"),
    "a load in grams": (",", lambda t, f, z: f"{t:.3f} s,{1e3 * f / 9.80665:.5f} g,{z:.6f} mm"),
}


def device(path):
    suggestion = suggest_csv(path, {})
    return CsvReplay.model_validate({k: v for k, v in suggestion.device.items() if k != "type"}), suggestion


@pytest.mark.parametrize("form", FORMS)
def test_cells_with_units_are_numbers_in_these(tmp_path, form):
    """No table of numbers was found in any of them."""
    separator, write = FORMS[form]
    path = tmp_path / "a.csv"
    path.write_text(NAMES.replace(",", separator) + rows(write))
    log, suggestion = device(path)
    assert "force" not in " ".join(suggestion.guesses)
    with log.connect(0) as link:
        values = np.concatenate([batch.values for batch in link.batches()])
    names = list(log.columns)
    np.testing.assert_allclose(values[:, names.index("force")], PRESS.f[:400], atol=1e-6)
    np.testing.assert_allclose(values[:, names.index("position")], PRESS.z[:400], atol=1e-8)


def test_names_of_records_may_look_like_quantities(tmp_path):
    path = tmp_path / "a.csv"
    parts = [rows(lambda t, f, z, name=name: f"{t:.3f},{f:.7f},{z:.6f},{name}") for name in ("10 mm", "20 mm")]
    path.write_text("time (s),force (N),height (mm),specimen\n" + "".join(parts))
    assert CsvReplay.records(path, {}) == ("10 mm", "20 mm")


def test_a_cell_of_another_quantity_is_refused(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(NAMES + rows(FORMS["with a space"][1]) + "9.9 s,0.2 mm,1.0 mm\n")
    log, _ = device(path)
    with (
        log.connect(0) as link,
        pytest.raises(LogError, match=r"a\.csv:402: column 1 holds '0\.2 mm', which is not a number"),
    ):
        list(link.batches())

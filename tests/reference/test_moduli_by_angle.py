"""Oscillations by a modulus and an angle, files of a Q800, units behind a stroke, and columns that a person names."""

import numpy as np
import pytest
from palpate import LogError
from palpate_reference.material_table import TableSettings
from palpate_reference.table_reader import read_tables
from palpate_reference.table_suggestion import suggested_commands

FREQUENCY = np.array([0.1, 0.3, 1.0, 3.0, 10.0])
STORAGE, LOSS = 1e3 * FREQUENCY**0.1, 300.0 * FREQUENCY**0.4
SIZE, ANGLE = np.hypot(STORAGE, LOSS), np.arctan2(LOSS, STORAGE)


def written(path, head, *columns):
    rows = "".join(",".join(f"{value:.9g}" for value in row) + "\n" for row in zip(*columns, strict=True))
    path.write_text(f"{head}\n{rows}")
    return path


KINDS = {
    "f [Hz],G' [Pa],tan delta": (STORAGE, np.tan(ANGLE)),
    "f [Hz],G' [kPa],Tan(delta)": (1e-3 * STORAGE, np.tan(ANGLE)),
    "f [Hz],Storage modulus (MPa),Loss factor": (1e-6 * STORAGE, np.tan(ANGLE)),
    "f [Hz],|G*| [Pa],delta [deg]": (SIZE, np.degrees(ANGLE)),
    "f [Hz],G* [Pa],phase angle [°]": (SIZE, np.degrees(ANGLE)),
    "Frequency [Hz],Complex shear modulus [Pa],phase [rad]": (SIZE, ANGLE),
    "f [Hz],|G*| [Pa],tan delta": (SIZE, np.tan(ANGLE)),
    "f/Hz,G'/Pa,G''/Pa": (STORAGE, LOSS),
    "f / Hz,G' / kPa,G'' / kPa": (1e-3 * STORAGE, 1e-3 * LOSS),
    "f in Hz,G' in Pa,G'' in Pa": (STORAGE, LOSS),
}


@pytest.mark.parametrize("head", KINDS)
def test_storage_and_loss_by_whatever_states_them(tmp_path, head):
    """All but the last were refused: no table of a material."""
    path = written(tmp_path / "table.csv", head, FREQUENCY, *KINDS[head])
    (table,) = read_tables(path, TableSettings({}, True))
    assert table.kind == "oscillation"
    np.testing.assert_allclose(table.x, FREQUENCY)
    np.testing.assert_allclose(table.y, np.column_stack([STORAGE, LOSS]), rtol=1e-6)
    assert any("palpate material" in line for line in suggested_commands(path))


def test_a_column_of_any_name_is_what_a_person_says(palpate, tmp_path):
    path = written(tmp_path / "table.csv", "nu [Hz],M1 [Pa],M2 [Pa]", FREQUENCY, STORAGE, LOSS)
    named = {"frequency": "nu", "storage": "M1", "loss": "M2 [Pa]"}
    (table,) = read_tables(path, TableSettings({}, True, named))
    np.testing.assert_allclose(table.y[:, 1], LOSS)
    options = [word for role, name in named.items() for word in ("--column", f"{role}={name}")]
    assert palpate("material", str(path), *options, "--modulus", "shear").returncode == 0
    with pytest.raises(LogError, match="--column: no column 'M3'"):
        read_tables(path, TableSettings({}, True, {"storage": "M3"}))
    with pytest.raises(LogError, match="no role 'storge'; did you mean 'storage'"):
        read_tables(path, TableSettings({}, True, {"storge": "M1"}))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8"])
@pytest.mark.parametrize("between", ["\t", " "])
def test_the_file_of_a_q800(tmp_path, encoding, between):
    """Its names stand in lines of their own, and negative times end a step."""
    names = [
        "Time (min)",
        "Temperature (°C)",
        "Storage Modulus (MPa)",
        "Tan Delta",
        "Stiffness (N/m)",
        "Frequency (Hz)",
    ]
    head = ["Instrument\tDMA Q800 V21.1 Build 51", "Sample\tgel", f"Nsig\t{len(names)}"]
    head += [f"Sig{k}\t{name}" for k, name in enumerate(names, 1)]
    head += ["OrgMethod\t1: Frequency sweep", "StartOfData"]
    time = np.arange(len(FREQUENCY)) / 10.0
    columns = (time, 25.0 + 0.0 * time, 1e-6 * STORAGE, LOSS / STORAGE, 100.0 + time, FREQUENCY)
    rows = [between.join(f"{value:.6e}" for value in row) for row in zip(*columns, strict=True)]
    end = between.join(["-2.000000e+00", *["0.000000e+00"] * 5])
    path = tmp_path / "gel.txt"
    path.write_text("\n".join([*head, *rows, end]) + "\n", encoding=encoding)
    (table,) = read_tables(path, TableSettings({}))
    assert not table.shear
    assert table.format == "Universal Analysis"
    np.testing.assert_allclose(table.x, FREQUENCY, rtol=1e-5)
    np.testing.assert_allclose(table.y, np.column_stack([STORAGE, LOSS]), rtol=1e-4)
    np.testing.assert_allclose(table.temperature, 25.0)

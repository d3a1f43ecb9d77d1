"""One record in pages, or with its header repeated, is one record where time, force and height go on."""

import json

import numpy as np
import pytest
from palpate_logs.csv_replay import CsvReplay
from palpate_logs.csv_roles import read_sheet
from palpate_records.tables.table_records import records_in

NAMES = "Time\tAxial Displacement\tAxial Force"
FORMS = {
    "titles and units": f"\nData Acquisition: Timed\tStation: rig\n{NAMES}\ns\tmm\tN\n",
    "title": f"\nTimed\n{NAMES}\ns\tmm\tN\n",
    "names alone": f"{NAMES}\n",
    "numbered titles": f"Page {{}}\n{NAMES}\ns\tmm\tN\n",
}
TIP = ["--tip", "paraboloid 3 mm"]


def press(n=800):
    """Time [s], depth [mm] and force [N] of a press on 50 kPa by a paraboloid of 3 mm, a hold and its return."""
    time = np.arange(n) / 100.0
    depth = np.interp(time, [0.0, 0.5, 3.0, 4.0, 6.5, 8.0], [0.0, 0.0, 2.5, 2.5, 0.0, 0.0])
    force = 16 / 9 * 50e3 * np.sqrt(3e-3) * np.maximum(1e-3 * (depth - 0.5), 0.0) ** 1.5
    return np.column_stack([time, depth, force + 2e-3 * np.random.default_rng(3).standard_normal(n)])


def written(path, pages, head=FORMS["titles and units"]):
    """A file of pages (n, 3), each under the same names."""
    heads = [head.format(k) for k in range(1, len(pages) + 1)]
    if "s\tmm\tN" not in head:
        heads = [one.replace(NAMES, "Time (s)\tAxial Displacement (mm)\tAxial Force (N)") for one in heads]
    lines = ["".join(f"{t:.3f}\t{z:.5f}\t{f:.5f}\n" for t, z, f in page) for page in pages]
    path.write_text("Controller|A|1|2\n" * ("Data" in head) + "".join(map("".join, zip(heads, lines, strict=True))))
    return path


def numbers_of(path, **keys):
    """Time [s], position and force as a replay reads them."""
    found = CsvReplay.suggest(path, {key: str(value) for key, value in keys.items()})
    device = {key: value for key, value in found.device.items() if key != "type"}
    with CsvReplay.model_validate(device, strict=False).connect(0) as link:
        batches = list(link.batches())
    time = np.concatenate([batch.time for batch in batches]) / 1e9
    return np.column_stack([time, np.concatenate([batch.values for batch in batches])])


@pytest.mark.parametrize("head", FORMS.values(), ids=FORMS)
@pytest.mark.parametrize("rows", [37, 200, 799])
def test_pages_are_read_as_the_file_without_them(tmp_path, head, rows):
    """They were several records, the first of 45.65 +- 1.6 kPa, good."""
    record = press()
    paged = written(tmp_path / "pages.txt", np.split(record, range(rows, len(record), rows)), head)
    whole = written(tmp_path / "whole.txt", [record], head)
    assert records_in(paged) == ()
    assert np.array_equal(read_sheet(paged, {}).values, read_sheet(whole, {}).values)
    assert np.array_equal(numbers_of(paged), numbers_of(whole))
    line = next(k for k, text in enumerate(paged.read_text().splitlines(), 1) if "Axial Force" in text)
    assert np.array_equal(numbers_of(paged, header=line), numbers_of(whole))


@pytest.mark.parametrize(
    ("column", "step"),
    [(0, 0.02), (0, -3.0), (0, 3600.0), (1, 0.4), (1, -0.4), (2, 0.05)],
    ids=["a row is missing", "time restarts", "an hour later", "height jumps", "height falls", "force jumps"],
)
def test_a_gap_or_a_jump_begins_a_new_record(tmp_path, column, step):
    one, two, three = np.split(press(), [250, 500])
    for page in (two, three):
        page[:, column] += step
    path = written(tmp_path / "pages.txt", [one, two, three])
    assert [record.pages for record in records_in(path)] == [1, 2]
    names = [record.name for record in records_in(path)]
    assert [len(read_sheet(path, {"record": name}).values) for name in names] == [250, 550]
    assert len(numbers_of(path, record=names[1])) == 550


def test_a_title_that_names_a_specimen_begins_a_new_record(tmp_path):
    head = f"Specimen {{}}\n{NAMES}\ns\tmm\tN\n"
    path = written(tmp_path / "pages.txt", np.split(press(), 2), head)
    assert [record.name for record in records_in(path)] == ["Specimen 1", "Specimen 2"]


def test_pages_in_other_units_are_records(tmp_path):
    one, two = np.split(press(), 2)
    path = written(tmp_path / "pages.txt", [one, two])
    text = path.read_text()
    place = text.rindex("s\tmm\tN")
    path.write_text(text[:place] + "s\tmm\tkN" + text[place + 6 :])
    assert len(records_in(path)) == 2


def test_rows_are_one_record_in_any_jitter_of_half_an_interval(tmp_path):
    record = press()
    record[:, 0] += 1e-3 * np.random.default_rng(1).uniform(-2.0, 2.0, len(record))
    assert records_in(written(tmp_path / "pages.txt", np.split(record, 4))) == ()


@pytest.mark.slow
def test_the_press_of_a_paged_file_is_one_row(palpate, tmp_path):
    """Its pages were 45.65 +- 1.6 (viscosity 1430 +- 150, both good), 50.02, 50.05 kPa and no contact."""
    record = press()
    written(tmp_path / "pages.txt", np.split(record, [200, 400, 600]))
    written(tmp_path / "whole.txt", [record])
    done = palpate("fit", "pages.txt", "whole.txt", *TIP, "--json", "-o", "out")
    assert done.returncode == 0, done.stderr
    one, other = json.loads(done.stdout)["files"]
    assert float(one["elasticity"]) == pytest.approx(50e3, rel=0.01)
    assert one["elasticity_verdict"] == "good"
    assert one["viscosity_verdict"] in ("not determined", "needs delay")
    assert one["elasticity"] == other["elasticity"]
    assert "the table ends" not in done.stderr

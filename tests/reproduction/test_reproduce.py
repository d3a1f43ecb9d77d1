"""The paper, reproduced: files by their hash, verdicts by their tolerance, and what counts as what."""

import csv
import gzip
import hashlib

import pytest
from palpate import ConfigurationError, LogError
from palpate_reproduction.item import (
    HERE,
    AuthorsRecording,
    Item,
    PublishedNumber,
    check_recordings,
    load_items,
    load_recordings,
)
from palpate_reproduction.item_rows import Maker, Row
from palpate_reproduction.item_table import csv_text, latex_text, tally
from palpate_reproduction.paper_formulas import value_of
from palpate_reproduction.recordings import find
from palpate_reproduction.reproduction_page import page

LABELS = {
    *(
        "elast_table",
        "forces",
        "loadcycle",
        "error_comp",
        "model_residuals",
        "model_residuals2",
        "hist_sil",
        "autocorr",
    ),
    *("moving_av", "elast_table2", "visc_silic", "el_silic2", "chicken_viscoelasticity", "traj", "model-comp"),
    *("fading_effect", "velocity_diff", "correction_factor"),
}
ARITHMETIC = {
    "row": "error", "quantity": "e", "value": 10.0, "tolerance": 0.05, "reason": "rounding", "source": "arithmetic",
    "formula": "100*(a/b - 1)",
}  # fmt: skip


def recording_of(content, **keys):
    digest = hashlib.sha256(content).hexdigest()
    known = {"repository": "x/y", "commit": "c", "path": "p", "bytes": len(content), "sha256": digest, "reason": "none"}
    return AuthorsRecording(**known | keys)


def test_every_label_of_the_paper_is_an_item_that_says_something():
    items = {item.name: item for item in load_items(HERE)}
    assert set(items) >= LABELS
    for item in items.values():
        assert item.published or item.missing, item.label
    check_recordings(list(items.values()), load_recordings(HERE))
    for recording in load_recordings(HERE).values():
        assert recording.reason
        assert "late" in recording.reason or "no delay" in recording.reason


def test_a_file_is_known_by_its_contents_plain_or_packed(tmp_path):
    wanted = {name: recording_of(name.encode() * 50) for name in ("one", "two", "three")}
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "renamed.bin").write_bytes(b"one" * 50)
    (tmp_path / "two.csv.gz").write_bytes(gzip.compress(b"two" * 50))
    (tmp_path / "three.csv").write_bytes(b"threX" * 50)  # the right size and name, another content
    (tmp_path / "cut.gz").write_bytes(gzip.compress(b"three" * 50)[:-9] + (250).to_bytes(4, "little"))
    found = find(tmp_path, wanted)
    assert {name: path.name for name, path in found.items()} == {"one": "renamed.bin", "two": "two.csv.gz"}
    with pytest.raises(LogError, match="no such folder"):
        find(tmp_path / "none", wanted)


@pytest.mark.parametrize(
    ("formula", "given", "value"), [("100*(a/b - 1)", {"a": 302.3, "b": 280.0}, 7.964), ("-a**2", {"a": 3.0}, -9.0)]
)
def test_formulas(formula, given, value):
    assert value_of(formula, given) == pytest.approx(value, rel=1e-3)


@pytest.mark.parametrize("formula", ["a(", "b", "__import__('os')", "a/0", "a.real", "9**9**9"])
def test_what_is_no_formula_is_refused(formula):
    with pytest.raises(ConfigurationError, match="formula"):
        value_of(formula, {"a": 1.0})


@pytest.mark.parametrize(
    ("a", "more", "status"),
    [
        (11.0, {}, "checked"),
        (12.0, {}, "outside"),
        (12.0, {"shown": "because"}, "shown"),
        (11.04, {"tolerance": 0.0}, "outside"),
    ],
)
def test_verdicts(tmp_path, a, more, status):
    published = PublishedNumber(**ARITHMETIC | {"given": {"a": a, "b": 10.0}} | more)
    (row,) = Maker(HERE, tmp_path, {}, {}).rows(Item(label="tab:x", title="x", published=(published,)))
    assert row.status == status


def test_what_is_simulated_never_counts_as_reproduced():
    base = {"row": "r", "quantity": "q", "value": 1.0, "tolerance": 0.1, "reason": "x", "pipeline": "p", "track": "t"}
    rows = []
    for source in ("simulated", "self-consistency"):
        rows.append(Row(PublishedNumber(**base, source=source), "agrees", 1.0, 0.1))
    assert tally(rows) == "2 simulated and within tolerance, which does not count as reproduced"
    item = Item(label="tab:x_y", title="50 % & more", published=tuple(row.published for row in rows))
    assert r"tab:x_y" in latex_text(item, rows)
    assert "self-consistency" in csv_text(item, rows)
    assert "50 % &amp; more" in page([(item, rows)], {})


def test_an_uncertain_ratio_has_both_uncertainties():
    base = {"row": "r", "quantity": "q", "tolerance": 0.1, "reason": "x", "pipeline": "p", "track": "t"}
    published = PublishedNumber(**base, value=200.0, spread=6.0, source="simulated")
    row = Row(published, "agrees", 100.0, 4.0)
    assert row.ratio == 0.5
    assert row.ratio_std == pytest.approx(0.5 * 0.05)


def test_without_recordings_all_of_them_are_named_and_skipped(palpate, tmp_path):
    done = palpate("reproduce", "visc_silic", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "5 skipped" in done.stdout
    assert "simulation_data_d5mm_hard.csv" in done.stdout
    assert palpate("reproduce", "tab:visc_silic", "--strict", "--out", tmp_path / "strict").returncode == 1
    wrong = palpate("reproduce", "visc_silc")
    assert wrong.returncode == 2
    assert "did you mean 'visc_silic'" in wrong.stderr


@pytest.mark.slow
def test_the_authors_recordings_give_the_published_numbers(palpate, shared, tmp_path):
    done = palpate("reproduce", "visc_silic", "el_silic2", "model_unc", "--data", shared, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stdout + done.stderr
    with (tmp_path / "out" / "el_silic2.csv").open() as file:
        rows = list(csv.DictReader(file))
    made = {(row["row"], row["quantity"]): row for row in rows if row["verdict"] == "reproduced"}
    assert len(made) == 4
    assert 0.95 < float(made["S4, sphere", "elasticity"]["ratio"]) < 1.05
    assert float(made["S4, sphere", "viscosity"]["ratio_std"]) > 0.1  # 0.5 ms of delay are 29 Pa s, and noise bias
    picture = (tmp_path / "out" / "el_silic2.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert int.from_bytes(picture[16:20]) > 1000  # wide enough to be read
    text = (tmp_path / "out" / "index.html").read_text()
    assert "d10mm_sphere" in text
    assert str(shared) not in text

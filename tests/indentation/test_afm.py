"""Force curves of atomic force microscopes: the device, and the same numbers as nanite on its own files."""

import contextlib
import copy
import json
import logging
import os
import tomllib
import warnings
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
from palpate import ConfigurationError, LogError, Problem
from palpate_engine.cli import call
from palpate_fits import CasadiFit
from palpate_indentation.approach_fit import fit_curve
from palpate_indentation.curve_source import whole_record
from palpate_indentation.elastic_law import law_of
from palpate_indentation.press import press_of
from palpate_logs import AfmReplay

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    afmformats = pytest.importorskip("afmformats", reason="afmformats is not installed")

HERE = Path(__file__).parents[2].parent / "shared" / "data" / "afm"
DATA = Path(os.environ.get("PALPATE_AFM_CURVES") or HERE)  # of the tests in nanite's source distribution
TIPS = {  # of this test, none is stated in a file: by nanite's name of the model
    "hertz_para": ('type = "sphere"\nradius = "5 um"', {"R": 5e-6}),
    "hertz_cone": ('type = "cone"\nangle = "65 deg"', {"alpha": 25.0}),
}
ENDINGS = (".jpk-force", ".jpk-force-map", ".jpk-qi-data", ".jpk-qi-series", ".h5", ".tab")
PIPELINE = """
[device.log]
type = "afm-replay"
file = "{file}"
record = "{curve}"
[alignment]
force = "log.force"
position = "log.height"
tare = "none"
tip_mass = 0.0
[indenter.tip]
{tip}
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
"""


def pipeline(folder, file, curve=0, tip=TIPS["hertz_para"][0], more=""):
    path = folder / "afm.toml"
    path.write_text(PIPELINE.format(file=file, curve=curve, tip=tip) + more)
    return path


def written(path, seed=4, mode="force-distance", hold=0, lag=0):
    """A curve of 3 kPa under 5 um, through afmformats; after `lag` readings of the way out the tip is deepest."""
    way = np.linspace(-2e-6, 8e-7, 1500)
    depth = np.concatenate([way, np.full(hold, 8e-7), way[::-1]])
    segment = np.repeat([0, 1, 2] if hold else [0, 1], [1500, hold, 1500] if hold else [1500, 1500])
    if lag:
        depth[1500 : 1500 + lag] = 8e-7 + 1e-9 * np.arange(lag)
    force = 16 / 9 * 3000.0 * np.sqrt(5e-6) * np.maximum(depth, 0) ** 1.5
    force[1500:] += lag * 1e-12  # what the way out has of its own
    noisy = force + 5e-12 * np.random.default_rng(seed).standard_normal(len(depth))
    data = {
        "force": noisy,
        "height (measured)": 5e-7 - depth - noisy / 0.05,
        "time": np.arange(len(depth)) / 2000,
        "segment": segment.astype(np.uint8),
    }
    facts = {"spring constant": 0.05, "imaging mode": mode, "enum": 0, "path": "made", "session id": "x"}
    facts |= {"curve id": "y", "duration approach": 0.75, "point count": len(depth)}
    kinds = {"force-distance": "AFMForceDistance", "creep-compliance": "AFMCreepCompliance"}
    getattr(afmformats, kinds[mode])(data, facts).export_data(path, fmt="hdf5")
    return path


@pytest.fixture
def made(tmp_path):
    """A curve as this test writes it: 3 kPa, 5 um, contact at 0.5 um."""
    return written(tmp_path / "made.h5")


def analysed(path, folder, *options):
    """What `palpate fit indentation` writes."""
    call(["fit", "indentation", str(path), "--out", str(folder), *options])
    return json.loads((folder / "indentation.json").read_text())


def test_a_curve_that_was_written_is_found(made, tmp_path):
    whole = whole_record(pipeline(tmp_path, made), (), None)
    law = law_of(whole.model, "dr", {})
    press = press_of(whole.samples, segment=whole.segment)
    fit = fit_curve(law, press.approach, press.noise, tilt=False)
    assert abs(fit.modulus - 3000.0) < 4 * fit.modulus_std
    assert fit.modulus_std < 60.0
    assert abs(fit.surface - 5e-7) < 4 * fit.surface_std
    assert press.retract is not None
    assert (len(press.approach), len(press.retract)) == (1500, 1500)


def test_a_file_says_what_it_holds(made):
    survey = AfmReplay.survey(made)
    assert [topic.messages for topic in survey.topics] == [3000]
    suggestion = AfmReplay.suggest(made, {})
    assert suggestion.device == {"type": "afm-replay", "file": str(made)}
    assert not suggestion.blanks
    assert any("spring constant: 0.05 N/m" in text for text in suggestion.reasons)
    ((name, columns, batch),) = AfmReplay.tables(made)
    assert name == "curve 0"
    assert batch.values.shape == (3000, len(columns))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ('record = "0"|record = "3"', "no curve 3"),
        ('type = "afm-replay"|type = "afm-replay"\nheight = "piezo"', "holds no 'height (piezo)'"),
    ],
)
def test_what_a_file_lacks_is_said(made, tmp_path, change, words):
    path = pipeline(tmp_path, made)
    before, after = change.split("|")
    path.write_text(path.read_text().replace(before, after))
    with pytest.raises(LogError) as error:
        whole_record(path, (), None)
    assert words in str(error.value)


@pytest.mark.parametrize("content", [b"", b"no curve at all", b"PK\x03\x04" + bytes(200)])
@pytest.mark.parametrize("ending", ["jpk-force", "h5", "tab", "ibw"])
def test_damaged_files_are_refused_in_words(tmp_path, content, ending):
    file = tmp_path / f"bad.{ending}"
    file.write_bytes(content)
    with pytest.raises((LogError, ConfigurationError)) as error:
        whole_record(pipeline(tmp_path, file), (), None)
    assert str(file) in str(error.value)


def test_readings_of_the_way_out_are_none_of_the_way_in(tmp_path):
    """The tip sinks for 150 readings after the file's way in has ended: they belong to the way out."""
    path = written(tmp_path / "late.h5", lag=150)
    whole = whole_record(pipeline(tmp_path, path), (), None)
    press = press_of(whole.samples, segment=whole.segment)
    assert len(press.approach) == 1500
    assert len(press_of(whole.samples).approach) > 1600
    np.testing.assert_array_equal(press.approach.time, whole.samples.time[:1500])


def test_readings_at_rest_between_are_of_neither_way(tmp_path):
    path = written(tmp_path / "creep.h5", mode="creep-compliance", hold=400)
    whole = whole_record(pipeline(tmp_path, path), (), None)
    np.testing.assert_array_equal(np.unique(whole.segment, return_counts=True)[1], [1500, 1500, 400])
    press = press_of(whole.samples, segment=whole.segment)
    assert (len(press.approach), len(press.retract)) == (1500, 1500)
    assert press.retract.time[0] == pytest.approx(1900 / 2000)


@pytest.mark.slow
def test_a_log_of_a_run_has_the_segments_of_its_curve(made, tmp_path):
    path = pipeline(tmp_path, made, more='[estimator.fit]\ntype = "casadi-fit"\n[sink.log]\ntype = "mcap"\n')
    call(["run", str(path), "--out", str(tmp_path / "run")])
    expected, found = (whole_record(place, (), None).segment for place in (path, tmp_path / "run"))
    np.testing.assert_array_equal(found, expected)


def test_a_suggestion_asks_for_the_tip_and_hangs_nothing_behind_it(made, tmp_path, capsys):
    path = tmp_path / "suggested.toml"
    call(["info", str(made), "--suggest", "-o", str(path)])
    assert "the tip: the file does not state its shape and size" in capsys.readouterr().err
    tables = tomllib.loads(path.read_text())
    assert tables["alignment"]["tip_mass"] == "0 g"
    assert tables["indenter"]["tip"]["radius"] == "? um"
    with pytest.raises(ConfigurationError, match="radius"):
        call(["run", str(path)])


def test_fit_and_press_agree_on_the_way_in(made, tmp_path):
    whole = whole_record(pipeline(tmp_path, made), ("alignment.measuring=log.approach",), None)
    press = press_of(whole.samples, segment=whole.segment)
    fit = fit_curve(law_of(whole.model, "dr", {}), press.approach, press.noise, tilt=False)
    found = CasadiFit(fixed={"viscosity": 0.0}).start(Problem(whole.model, 0.0, None)).run(whole.samples)
    last = int(np.flatnonzero(np.isfinite(found.values[:, 0]))[-1])
    assert whole.samples.time[last] < 0.75
    assert abs(found.values[last, 0] - fit.modulus) < 2 * np.hypot(found.std[last, 0], fit.modulus_std)
    assert abs(found.values[last, 0] - 3000.0) < 3 * found.std[last, 0]


@pytest.mark.slow
def test_run_fit_and_indentation_agree_by_what_is_suggested(made, tmp_path):
    """The truth is 3 kPa; nothing but the radius is filled in."""
    path = tmp_path / "suggested.toml"
    call(["info", str(made), "--suggest", "-o", str(path)])
    path.write_text(path.read_text().replace("? um", "5 um"))
    press = analysed(path, tmp_path / "press")
    call(["run", str(path), "--out", str(tmp_path / "run")])
    call(["fit", str(path), "--out", str(tmp_path / "fit")])
    (fit,) = (tmp_path / "fit").glob("*/result.json")
    for document in (tmp_path / "run" / "result.json", fit):
        track = json.loads(document.read_text())["tracks"]["dr/fit"]
        value = track["parameters"]["elasticity"]
        assert abs(value["value"] - 3000.0) < 2 * value["combined"]
        both = np.hypot(value["combined"], press["combined"])
        assert abs(value["value"] - press["value"]) < 2 * both
        assert value["combined"] < 600.0
    assert abs(press["value"] - 3000.0) < 2 * press["combined"]


def curves():
    """Every force curve that is at hand: file, and which one of it; of large maps the first four."""
    found = []
    for path in sorted(DATA.iterdir()) if DATA.is_dir() else ():
        if path.name.endswith(ENDINGS):
            with contextlib.suppress(LogError):  # what afmformats does not read either
                found += [(path, place) for place in range(min(len(AfmReplay.survey(path).topics), 4))]
    return found


def by_nanite(curve, key, numbers, start):
    """Modulus of nanite's fit to the way in: from where it begins by itself, or from `start`, whichever fits better."""
    curve.apply_preprocessing(["compute_tip_position"])
    given = curve.get_initial_fit_parameters(model_key=key)
    for name, number in {**numbers, "nu": 0.5}.items():
        given[name].value = number
    near = copy.deepcopy(given)
    near["E"].value, near["contact_point"].value, near["baseline"].value = start
    found = []
    for parameters in (given, near):
        options = {"weight_cp": 0, "segment": "approach", "params_initial": parameters}
        curve.fit_model(model_key=key, method_kws={"ftol": 1e-14, "xtol": 1e-14}, **options)
        rows = np.asarray(curve["segment"]) == 0
        left = np.asarray(curve["force"])[rows] - np.asarray(curve["fit"])[rows]
        found.append((float(left @ left), float(curve.fit_properties["params_fitted"]["E"].value)))
    return min(found)[1]


@pytest.mark.slow
@pytest.mark.parametrize("key", TIPS)
def test_the_same_modulus_as_nanite_on_every_curve(key, tmp_path):
    """Within 1e-3 on the same segment, by the command line, wherever palpate finds a press.

    Nanite's fit is the better one of two starts, one of them palpate's result. Where the way in sticks it is compared
    with what palpate finds without adhesion, which nanite's models leave out.
    """
    nanite = pytest.importorskip("nanite", reason="nanite is not installed")
    if not (places := curves()):
        pytest.skip(f"{DATA} has no curves: they are in nanite's source distribution; PALPATE_AFM_CURVES names theirs")
    tip, numbers = TIPS[key]
    compared = 0
    for i, (path, place) in enumerate(places):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            theirs = nanite.IndentationGroup(path)
            if len(theirs) <= place:  # no force-distance curve
                continue
            try:
                found = analysed(pipeline(tmp_path, path, place, tip), tmp_path / f"{i}", "--no-tilt")
            except LogError:
                continue
            start = found["value"], found["surface"]["value"], found["baseline"]["offset"]
            expected = by_nanite(theirs[place], key, numbers, start)
        value = (found["adhesion_on_the_way_in"] or {}).get("value_without", found["value"])
        assert value == pytest.approx(expected, rel=1e-3), (path.name, place)
        compared += 1
    assert compared


def test_a_curve_whose_numbers_are_damaged_is_named(tmp_path):
    """HDF5 reads and unpacks them when they are asked for."""
    path = written(tmp_path / "curve.h5")
    raw, found = path.read_bytes(), set()
    for at in range(4000, len(raw), len(raw) // 40):
        path.write_bytes(raw[:at] + bytes(8) + raw[at + 8 :])
        try:
            found.add(len(list(AfmReplay.tables(path))))
        except LogError as error:
            found.add(str(error).startswith(f"{path}: its ") and "cannot be read" in str(error))
    assert True in found


def test_a_rate_is_for_a_curve_without_a_time(tmp_path):
    path = written(tmp_path / "a.h5")
    found = AfmReplay.suggest(path, {"rate": "100 Hz"})
    assert "rate" not in found.device
    assert found.has_time
    with (
        pytest.raises(LogError, match="contains a time: leave out rate"),
        AfmReplay(file=path, rate=100.0).connect(0) as link,
    ):
        list(link.batches())


def test_a_damaged_curve_is_one_error_without_the_traceback_of_the_library(tmp_path, monkeypatch, capsys):
    """As of an uncalibrated JPK file, whose reader logs what it raises."""
    h5py = pytest.importorskip("h5py")
    path = written(tmp_path / "a.h5")
    with h5py.File(path, "r+") as file:
        file["0"].create_group("no column")
    for logger in (logging.getLogger(), logging.getLogger("afmformats")):  # as in a process that has set up none
        monkeypatch.setattr(logger, "handlers", [])
    with pytest.raises(LogError, match=r"a\.h5: cannot be read as a force curve: ValueError: Unknown column"):
        AfmReplay.survey(path)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("error", [zipfile.BadZipFile("Bad CRC-32"), zlib.error("Error -3"), KeyError("height")])
def test_a_damaged_column_is_named(tmp_path, monkeypatch, error):
    """As a flipped bit in one of a JPK file, which is unpacked when it is asked for."""
    path = written(tmp_path / "a.h5")

    def damaged(self, name):
        raise error

    monkeypatch.setattr(afmformats.AFMForceDistance, "__getitem__", damaged)
    with pytest.raises(LogError, match=rf"a\.h5: its time cannot be read: {type(error).__name__}"):
        AfmReplay.survey(path)


def test_a_tip_that_is_stated_is_not_asked_for(made):
    """The file "does not state its shape" stood below a command that stated it."""
    asked, stated = (AfmReplay.suggest(made, choices).doubts for choices in ({}, {"tip": "sphere 5 um"}))
    assert any("the file does not state its shape" in text for text in asked)
    assert not any("the file does not state its shape" in text for text in stated)

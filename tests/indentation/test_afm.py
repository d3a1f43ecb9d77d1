"""Force curves of atomic force microscopes: the device, and the same numbers as nanite on its own files."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from palpate import ConfigurationError, LogError
from palpate_indentation.approach_fit import fit_curve
from palpate_indentation.curve_source import whole_record
from palpate_indentation.elastic_law import law_of
from palpate_indentation.press import press_of
from palpate_logs import AfmReplay

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    afmformats = pytest.importorskip("afmformats", reason="afmformats is not installed")

HERE = Path(__file__).parents[2].parent / "shared" / "data" / "afm"
DATA = Path(os.environ.get("PALPATE_AFM_CURVES") or HERE)  # of the tests in nanite's source distribution on PyPI
CURVES = {  # which curve, and how near; of the last, nanite stops at a sum of squares that is higher by 2e-6
    "fmt-jpk-fd_spot3-0192.jpk-force": (0, 1e-3),
    "fmt-jpk-fd_single_tilted-baseline-drift-mitotic_2021-01-29.jpk-force": (0, 1e-3),
    "fmt-jpk-fd_map2x2_extracted.jpk-force-map": (1, 1.2e-3),
}
PIPELINE = """
[device.log]
type = "afm-replay"
file = "{file}"
curve = {curve}
[alignment]
force = "log.force"
position = "log.height"
tare = "none"
tip_mass = 0.0
[indenter.tip]
type = "sphere"
radius = "{radius}"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
"""


def pipeline(folder, file, curve=0, radius="5 um", more=""):
    path = folder / "afm.toml"
    path.write_text(PIPELINE.format(file=file, curve=curve, radius=radius) + more)
    return path


@pytest.fixture
def made(tmp_path):
    """A curve as this test writes it, through afmformats: 3 kPa, 5 um, contact at 0.5 um."""
    depth = np.concatenate([np.linspace(-2e-6, 8e-7, 1500), np.linspace(8e-7, -2e-6, 1500)])
    force = 16 / 9 * 3000.0 * np.sqrt(5e-6) * np.maximum(depth, 0) ** 1.5
    noisy = force + 5e-12 * np.random.default_rng(4).standard_normal(3000)
    data = {
        "force": noisy,
        "height (measured)": 5e-7 - depth - noisy / 0.05,
        "time": np.arange(3000) / 2000,
        "segment": np.repeat([0, 1], 1500).astype(np.uint8),
    }
    facts = {"spring constant": 0.05, "imaging mode": "force-distance", "enum": 0, "path": "made", "session id": "x"}
    facts |= {"curve id": "y", "duration approach": 0.75, "point count": 3000}
    path = tmp_path / "made.h5"
    afmformats.AFMForceDistance(data, facts).export_data(path, fmt="hdf5")
    return path


def test_a_curve_that_was_written_is_found(made, tmp_path):
    whole = whole_record(pipeline(tmp_path, made), (), None)
    law = law_of(whole.model, "dr", {})
    press = press_of(whole.samples)
    fit = fit_curve(law, press.approach, press.noise, tilt=False)
    assert abs(fit.modulus - 3000.0) < 4 * fit.modulus_std
    assert fit.modulus_std < 60.0
    assert abs(fit.surface - 5e-7) < 4 * fit.surface_std
    assert press.retract is not None
    assert len(press.retract) == pytest.approx(1500, abs=2)


def test_a_file_says_what_it_holds(made):
    survey = AfmReplay.survey(made)
    assert [topic.messages for topic in survey.topics] == [3000]
    suggestion = AfmReplay.suggest(made, {})
    assert suggestion.device == {"type": "afm-replay", "file": str(made)}
    assert not suggestion.blanks
    ((name, columns, batch),) = AfmReplay.tables(made)
    assert name == "curve 0"
    assert batch.values.shape == (3000, len(columns))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("curve = 0|curve = 3", "there is no curve 3"),
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


@pytest.mark.parametrize("name", CURVES)
def test_the_same_modulus_as_nanite_on_its_files(name, tmp_path):
    if not (DATA / name).is_file():
        pytest.skip(f"{DATA / name} is absent: a file of nanite's tests; PALPATE_AFM_CURVES names its folder")
    place, near = CURVES[name]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        nanite = pytest.importorskip("nanite", reason="nanite is not installed")
        curve = nanite.IndentationGroup(DATA / name)[place]
        curve.apply_preprocessing(["compute_tip_position"])
        start = curve.get_initial_fit_parameters(model_key="hertz_para")
        start["R"].value, start["nu"].value = 5e-6, 0.5
        for _ in range(3):  # begun again from where it stopped: it stops early
            options = {"weight_cp": 0, "segment": "approach", "params_initial": start}
            curve.fit_model(model_key="hertz_para", method_kws={"ftol": 1e-14, "xtol": 1e-14}, **options)
            start = curve.fit_properties["params_fitted"]
        theirs, count = start, int(np.count_nonzero(np.asarray(curve["segment"]) == 0))
    whole = whole_record(pipeline(tmp_path, DATA / name, place), (), None)
    press = press_of(whole.samples[:count])  # the same readings: the file's own end of the way in
    assert len(press.approach) > count - 10
    fit = fit_curve(law_of(whole.model, "dr", {}), press.approach, press.noise, tilt=False)
    assert fit.modulus == pytest.approx(theirs["E"].value, rel=near)
    assert fit.surface == pytest.approx(theirs["contact_point"].value, abs=1e-3 * np.ptp(press.approach.height))

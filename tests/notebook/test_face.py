"""The Python face: runs, records, fits, comparisons, sweeps and maps, as a notebook uses them."""

import dataclasses
import gc
import json
import math
import pickle
import warnings

import numpy as np
import palpate
import pandas as pd
import pytest
from palpate import ConfigurationError, LogError, OutputError
from palpate_models import DimensionalityReduction, Sphere
from palpate_notebook import UncertainQuantity

ROUNDING = 1e-12
FORCE = {"force": "/rig/wrench:wrench.force.z"}


@pytest.fixture(scope="module")
def short(root):
    return palpate.load(root / "pipelines" / "filters.toml").set("trajectory.press.duration", "2 s")


@pytest.fixture(scope="module")
def kept(short, tmp_path_factory):
    """A run with a folder."""
    return short.run(tmp_path_factory.mktemp("face") / "run")


@pytest.fixture(scope="module")
def arrays(kept):
    samples = kept.samples
    return {
        "time": samples["time"].values,
        "force": samples["force"].values,
        "height": samples["position"].values,
        "velocity": samples["velocity"].values,
    }


@pytest.fixture(scope="module")
def record(arrays):
    return palpate.record(**arrays, timing="0.14 ms", tip_mass="140 g")


@pytest.fixture(scope="module")
def fitted(record):
    return palpate.fit(record, tip=Sphere(radius="5 mm"), model="dr")


@pytest.mark.gate
@pytest.mark.slow
def test_a_run_is_that_of_the_command_line(kept):
    written = json.loads((kept.folder / "result.json").read_text())
    assert kept.document == written
    track = kept["dr/kinematic"]
    table = written["tracks"]["dr/kinematic"]["parameters"]["elasticity"]
    assert (track.elasticity.value, track.elasticity.std, track.elasticity.combined) == (
        table["value"],
        table["std"],
        table["combined"],
    )
    assert abs(track.elasticity.value - kept.truth["elasticity"]) < 3 * track.elasticity.combined
    assert str(track.elasticity).endswith(" kPa")
    assert "±" in str(track.elasticity)


def test_the_budget_is_what_the_combined_uncertainty_is_made_of(kept):
    quantity = kept["dr/kinematic"].elasticity
    assert math.hypot(*quantity.budget.values()) == pytest.approx(quantity.combined, rel=1e-9)
    frame = kept["dr/kinematic"].budget()
    assert frame.loc["combined", "elasticity"] == quantity.combined
    assert frame.loc["estimator", "elasticity"] == quantity.std


@pytest.mark.slow
def test_without_a_folder_nothing_stays(short):
    run = short.set("trajectory.press.duration", "0.2 s").run()
    folder = run.folder
    assert (folder / "result.json").is_file()
    del run
    gc.collect()
    assert not folder.exists()


def test_what_is_refused_leaves_no_folder(short, tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    lost = short.set("device.rig", "x")
    with pytest.raises(ConfigurationError):
        lost.run()
    with pytest.raises(ConfigurationError):
        palpate.sweep(short, {"run.sed": [1]})
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_estimates_and_samples_have_dimensions_and_units(kept):
    estimates, samples = kept.estimates, kept.samples
    assert estimates["elasticity"].dims == ("track", "time")
    assert list(estimates["track"].values) == list(kept)
    assert estimates["elasticity"].attrs["units"] == "Pa"
    assert samples["force"].dims == ("time",)
    assert {name: samples[name].attrs["units"] for name in ("force", "position", "velocity", "time")} == {
        "force": "N",
        "position": "m",
        "velocity": "m/s",
        "time": "s",
    }
    last = estimates["elasticity"].sel(track="dr/kinematic").dropna("time")
    assert last.where(last["time"] > last["time"][-1] - 1.0).mean() == pytest.approx(
        kept["dr/kinematic"].elasticity.value, rel=1e-3
    )


@pytest.mark.slow
def test_a_run_that_is_opened_is_the_run(kept):
    opened = palpate.open_run(kept.folder)
    assert opened.document == kept.document
    np.testing.assert_array_equal(opened.samples["force"], kept.samples["force"])
    again = opened.replay()
    np.testing.assert_array_equal(again.estimates["elasticity"], kept.estimates["elasticity"])
    thin = opened.estimates["elasticity"]
    np.testing.assert_allclose(thin, kept.estimates["elasticity"].sel(time=thin["time"], method="nearest"), rtol=1e-9)


def test_summary(kept):
    frame = kept.summary()
    assert list(frame.columns) == ["value", "std", "combined", "unit", "verdict"]
    row = frame.loc[("dr/kinematic", "elasticity")]
    assert row["unit"] == "kPa"
    assert row["value"] == pytest.approx(1e-3 * kept["dr/kinematic"].elasticity.value, rel=ROUNDING)
    assert kept.summary(si=True).loc[("dr/kinematic", "elasticity"), "unit"] == "Pa"


def test_what_a_notebook_shows(kept):
    html = kept._repr_html_()
    assert html.count("<tr>") == 4  # head, two tracks, truth
    assert kept["dr/kinematic"].elasticity.number in html
    for flags in kept.flags.values():
        for flag in flags:
            assert flag.code in html
            assert flag.code in repr(kept)


def test_names_of_a_run_are_no_markup(short):
    run = short.set("run.name", "<script>alert(1)</script>").set("trajectory.press.duration", "0.2 s").run()
    assert "<script>" not in run._repr_html_()


@pytest.mark.slow
def test_pictures(kept, fitted, tmp_path):
    for number, picture in enumerate(
        [kept.plot(), kept.plot("elasticity"), kept.plot.force_depth(), kept.plot.force("dr/kinematic"), fitted.plot()]
    ):
        assert picture._repr_png_().startswith(b"\x89PNG")
        assert picture.save(tmp_path / f"{number}.svg").stat().st_size > 1000
        assert all(axis.lines for axis in picture.axes)


@pytest.mark.parametrize(
    ("do", "what"),
    [
        (lambda run: run["dr/kinematik"], "did you mean 'dr/kinematic'"),
        (lambda run: run["dr/ekf"]["elastisity"], "did you mean 'elasticity'"),
        (lambda run: run.plot("viscosty"), "did you mean 'viscosity'"),
        (lambda run: run.plot.force("dr"), "no track 'dr'"),
        (lambda run: run["dr/ekf"].elasticity.to("mm"), "elasticity"),
        (lambda run: run.map(cell="3 kg"), "cell: '3 kg' is a mass"),
        (lambda run: run.map(method="magic"), "magic"),
    ],
)
def test_mistakes_are_told(kept, do, what):
    with pytest.raises(ConfigurationError, match=what):
        do(kept)


@pytest.mark.slow
def test_a_report(kept, tmp_path, capsys):
    page = kept.report(tmp_path / "point.html")
    assert kept.name in page.read_text()
    assert capsys.readouterr().out == ""


def test_nothing_is_overwritten(kept, tmp_path):
    kept.save(tmp_path / "copy")
    assert palpate.open_run(tmp_path / "copy").document == kept.document
    with pytest.raises(OutputError, match="exists already"):
        kept.save(tmp_path / "copy")


def test_mistakes_of_the_file_are_those_of_the_command_line(short):
    with pytest.raises(ConfigurationError, match=r"radius: '5 kPa' is a pressure"):
        short.set("indenter.tip.radius", "5 kPa").run()
    with pytest.raises(ConfigurationError, match="is a table"):
        short.set("indenter.tip", {"radius": "5 mm"})
    with pytest.raises(ConfigurationError, match="cannot be written in a pipeline file"):
        short.set("run.seed", object())


def test_a_change_makes_a_new_draft(short):
    assert short.set("run.seed", 7).check().run.seed == 7
    assert short.check().run.seed == 1


# Records


@pytest.mark.slow
def test_a_value_is_a_number_in_si_wherever_one_is_wanted(fitted):
    elasticity, viscosity = fitted.elasticity, fitted.viscosity
    value = elasticity.value
    assert (elasticity * 2, 2 * elasticity, elasticity / 1e3) == (2 * value, 2 * value, value / 1e3)
    assert np.log(elasticity) == math.log(value)
    assert max(viscosity, elasticity) is elasticity
    np.testing.assert_array_equal(np.array([elasticity, viscosity]), [value, viscosity.value])
    assert json.loads(json.dumps(elasticity)) == value
    again = pickle.loads(pickle.dumps(elasticity))
    assert (str(again), again.budget) == (str(elasticity), elasticity.budget)


@pytest.mark.parametrize(
    ("spec", "text"),
    [
        ("", "112.84 ± 0.20 kPa"),
        (".1f", "112.8 ± 0.2 kPa"),
        ("+.3e", "+1.128e+02 ± 2.000e-01 kPa"),
        ("20.0f", "         113 ± 0 kPa"),
        ("<20", "112.84 ± 0.20 kPa   "),
    ],
)
def test_a_value_is_written_by_a_specification(spec, text):
    assert format(UncertainQuantity("elasticity", 112840.0, 160.0, 200.0, "Pa"), spec) == text


@pytest.mark.slow
def test_a_value_for_other_libraries(fitted):
    viscosity = fitted.viscosity
    twice = 2 * viscosity.to_uncertainties()
    assert (twice.n, twice.s) == (2 * viscosity.value, 2 * viscosity.combined)
    measured = viscosity.to_pint().to("kPa*s")
    assert measured.magnitude.n == pytest.approx(1e-3 * viscosity.value, rel=ROUNDING)
    assert measured.magnitude.s == pytest.approx(1e-3 * viscosity.combined, rel=ROUNDING)


def test_a_value_in_a_setting_is_its_number(short, fitted):
    draft = short.set("estimator.kinematic.force_std", UncertainQuantity("noise", 0.03, 1e-3, 1e-3, "N"))
    assert draft.changes[-1] == "estimator.kinematic.force_std=0.03"


def test_a_fit_as_rows(fitted):
    row = fitted.to_dict()
    assert row["elasticity_combined"] == fitted.elasticity.combined
    assert row["verdict"] == fitted.verdict
    frame = fitted.frame
    np.testing.assert_array_equal(frame["residual"], fitted.residuals)
    known = np.isfinite(fitted.residuals)
    assert known.sum() == row["samples"]
    assert np.sqrt(np.mean(fitted.residuals[known] ** 2)) == pytest.approx(fitted.residual, rel=0.01)
    assert frame["force"].std() > 20 * frame["residual"].std()


@pytest.mark.parametrize(
    ("of", "name", "meant"),
    [
        (lambda fit: fit, "elastisity", "elasticity"),
        (lambda fit: fit.track, "parameter", "parameters"),
        (lambda fit: fit.run, "estimate", "estimates"),
        (lambda fit: fit.elasticity, "unitt", "unit"),
        (lambda _: palpate, "recrd", "record"),
    ],
)
def test_a_name_that_is_not_there_is_told_with_one_that_is(fitted, of, name, meant):
    with pytest.raises(AttributeError, match=f"did you mean '{meant}'"):
        getattr(of(fitted), name)


def test_a_property_that_fails_says_why(record):
    broken = dataclasses.replace(record, devices={"record": {"type": "memory-record", "sha256": 0}})
    with pytest.raises(ConfigurationError, match="sha256"):
        _ = broken.samples


@pytest.mark.parametrize(
    ("keys", "what"),
    [
        ({"radus": "5 mm"}, r"^Sphere: unknown key 'radus'; did you mean 'radius'\? \(there is: radius\)$"),
        ({"radius": "5 kg"}, "^Sphere: radius: '5 kg' is a mass, not a length; write for example \"5 mm\"$"),
        ({}, r"^Sphere: radius: is missing"),
    ],
)
def test_a_mistake_in_a_part_is_one_sentence(keys, what):
    with pytest.raises(ConfigurationError, match=what):
        Sphere(**keys)


def test_what_a_notebook_shows_of_a_record_and_a_value(record, fitted):
    html = record._repr_html_()
    assert "uncertainty 0.14 ms" in html
    assert "140 g" in html
    html = fitted.elasticity._repr_html_()
    assert fitted.elasticity.number in html
    sources = sorted(fitted.elasticity.budget, key=lambda source: -fitted.elasticity.budget[source])
    assert [html.index(source) for source in sources] == sorted(html.index(source) for source in sources)


def test_a_fit_finds_the_truth(fitted, kept):
    for name in ("elasticity", "viscosity"):
        found = fitted[name]
        assert abs(found.value - kept.truth[name]) < 3 * found.combined
    assert fitted.elasticity.combined / fitted.elasticity.value < 0.02  # that it is no layer is a condition
    assert "thickness" in {one["fact"] for one in fitted.track.document["conditions"]}
    assert fitted.budget().loc["timing", "u"] == pytest.approx(1.4e-4)
    np.testing.assert_allclose(np.diag(fitted.correlation), 1.0)
    np.testing.assert_array_equal(fitted.correlation, fitted.correlation.T)
    assert -1 <= fitted.correlation.loc["elasticity", "surface"] < -0.5


def test_a_thick_specimen_is_known_better(record, kept):
    thick = DimensionalityReduction(indenter=Sphere(radius="5 mm"), thickness="half-space")
    found = palpate.fit(record, model=thick).elasticity
    assert abs(found.value - kept.truth["elasticity"]) < 3 * found.combined
    assert found.combined < 0.05 * found.value


@pytest.mark.slow
def test_units_of_any_kind_make_the_same_record(arrays, record):
    import pint
    import xarray

    unit = pint.UnitRegistry()
    millimetres = 1e3 * arrays["height"]
    frame = pd.DataFrame({"t": arrays["time"], "z": millimetres, "f": arrays["force"], "v": arrays["velocity"]})
    common = {"timing": "0.14 ms", "tip_mass": 0.14}
    by_units = palpate.record(
        time=frame["t"], force=frame["f"], height=frame["z"], velocity=frame["v"], units={"height": "mm"}, **common
    )
    by_pint = palpate.record(
        **{**arrays, "height": millimetres * unit.mm, "time": 1e3 * arrays["time"] * unit.ms}, **common
    )
    labelled = xarray.DataArray(millimetres, attrs={"units": "mm"})
    by_label = palpate.record(**{**arrays, "height": labelled}, **common)
    for other in (by_units, by_pint, by_label):
        np.testing.assert_allclose(other.columns.values, record.columns.values, rtol=1e-12, atol=1e-15)
        np.testing.assert_array_equal(other.columns.time, record.columns.time)


@pytest.mark.slow
def test_pint_converts_what_it_knows_and_refuses_another_dimension(arrays):
    import pint

    unit = pint.UnitRegistry()
    angstroms = palpate.record(**{**arrays, "height": arrays["height"] / 1e-10 * unit.angstrom})
    np.testing.assert_allclose(
        angstroms.columns.values, palpate.record(**arrays).columns.values, rtol=1e-12, atol=1e-15
    )
    with pytest.raises(palpate.ConfigurationError, match="height: Cannot convert from 'newton'"):
        palpate.record(**{**arrays, "height": arrays["height"] * unit.N})


def test_the_same_readings_are_the_same_record(arrays):
    one, other = palpate.record(**arrays), palpate.record(**arrays)
    assert one.devices == other.devices
    changed = palpate.record(**{**arrays, "force": arrays["force"] + 1e-12})
    assert changed.devices != one.devices


def test_declared_delay_and_sign_act_as_in_a_pipeline(arrays):
    late = {**arrays, "force": -arrays["force"], "height": arrays["height"]}
    record = palpate.record(**late, sign=-1, delay={"velocity": "2 ms"}, tare="none")
    assert record.alignment["force"] == {"channel": "record.force", "sign": -1}
    assert record.alignment["velocity"]["delay"] == "2 ms"
    plain = palpate.record(**arrays, delay={"velocity": "2 ms"}, tare="none")
    np.testing.assert_array_equal(record.samples["force"], plain.samples["force"])


@pytest.mark.slow
def test_what_is_not_declared_is_a_condition(arrays):
    fit = palpate.fit(palpate.record(**arrays), tip=Sphere(radius="5 mm"))
    assert "delay" in {one["fact"] for one in fit.track.document["conditions"]}


def test_the_same_fit_to_the_bit(record, fitted):
    again = palpate.fit(record, tip=Sphere(radius="5 mm"), model="dr")
    assert again.track.document["parameters"] == fitted.track.document["parameters"]


@pytest.mark.slow
def test_a_tip_mass_of_zero(arrays):
    record = palpate.record(**arrays, tip_mass=0, timing="0.1 ms")
    light = palpate.compare(record, tip=Sphere(radius="5 mm"), estimators=["kinematic-ekf", "casadi-fit"])
    for track in light.tracks.values():
        assert track.elasticity.value == pytest.approx(112.5e3, rel=0.1)
    with pytest.raises(ConfigurationError, match="mass is 0"):
        palpate.compare(record, tip=Sphere(radius="5 mm"), estimators=["ekf"])


@pytest.mark.slow
def test_parts_are_classes_with_units(record):
    model = DimensionalityReduction(indenter=Sphere(radius="5 mm"), poisson=0.49)
    run = palpate.compare(record, models=[model, "kv"], estimators=["casadi-fit"])
    assert list(run) == ["dimensionality-reduction/casadi-fit", "kv/casadi-fit"]
    assert run.pipeline["model"]["dimensionality-reduction"]["poisson"] == 0.49
    assert run.estimates["stiffness"].sel(track="dimensionality-reduction/casadi-fit").isnull().all()


@pytest.mark.slow
def test_a_log_is_a_record(kept):
    record = palpate.read(kept.folder)
    found = palpate.fit(record, tip=Sphere(radius="5 mm"))
    assert abs(found.elasticity.value - kept.truth["elasticity"]) < 3 * found.elasticity.combined
    np.testing.assert_array_equal(record.samples["force"], kept.samples["force"])


def open_facts(record):
    return {one["fact"] for one in palpate.fit(record, tip=Sphere(radius="5 mm")).track.document["conditions"]}


@pytest.mark.slow
def test_other_signals_of_a_log_begin_from_what_it_carries(kept):
    """The mass and tare of its run stay; what its channel was late by says nothing of another one."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        own, other, late = (
            palpate.read(kept.folder / "log.mcap", signals, delay=delay)
            for signals, delay in ((None, None), (FORCE, None), (FORCE, {"force": "0 ms"}))
        )
    assert other.alignment["tip_mass"] == own.alignment["tip_mass"]
    assert other.alignment["measuring"] == own.alignment["measuring"]
    assert own.assumed == late.assumed == ()
    assert other.assumed == ("alignment.force.delay",)
    assert {"delay", "alignment.force.delay"} & open_facts(other)
    assert not {"delay", "alignment.force.delay"} & open_facts(late)
    np.testing.assert_allclose(other.samples["force"], own.samples["force"], atol=1e-9)


@pytest.mark.slow
def test_what_nobody_stated_of_a_foreign_log_is_flagged(arrays, tmp_path):
    path = tmp_path / "mine.csv"
    pd.DataFrame(arrays).to_csv(path, index=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        silent = palpate.read(path)
        said = palpate.read(path, timing="0.1 ms", tare="none")
    assert said.assumed == ()
    assert {"alignment.tare", "alignment.force.delay"} <= set(silent.assumed)
    assert "delay" in open_facts(silent)
    assert "delay" not in open_facts(said)


def test_a_csv_is_a_record(arrays, tmp_path):
    path = tmp_path / "mine.csv"
    pd.DataFrame(arrays).to_csv(path, index=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is a guess is warned of
        record = palpate.read(path, {"force": "force", "height": "height", "velocity": "velocity", "time": "time"})
    assert record.alignment["force"]["channel"].endswith("force")
    assert len(record.samples["time"]) == len(arrays["time"])


def test_a_guess_is_warned_of_at_the_line_that_reads(arrays, tmp_path):
    path = tmp_path / "mine.csv"
    pd.DataFrame(arrays).to_csv(path, index=False)
    with pytest.warns(UserWarning, match="is a guess") as seen:
        palpate.read(path)
    assert {warning.filename for warning in seen} == {__file__}


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"force": [1.0, 2.0]}, "must be equally long: time has .*, force has 2"),
        ({"force": "words"}, "force: contains something that is not a number"),
        ({"force": np.ones((3, 2))}, "force: must be one column of numbers, not 3 x 2"),
        ({"force": 3.0}, "force: must be one column"),
        ({"time": None}, "give either time"),
        ({"rate": "500 Hz"}, "give either time"),
        ({"time": None, "rate": "-1 Hz"}, "must be above 0"),
        ({"time": None, "rate": "3 mm"}, "rate: '3 mm' is a length"),
        ({"units": {"hight": "mm"}}, "did you mean 'height'"),
        ({"units": {"height": "kg"}}, "height: .*mass"),
        ({"sign": {"forse": -1}}, "did you mean 'force'"),
        ({"delay": {"velocity": "1 ms"}, "velocity": None}, "no signal 'velocity'"),
    ],
)
def test_columns_that_are_none(arrays, change, what):
    with pytest.raises(ConfigurationError, match=what):
        palpate.record(**{**arrays, **change})


def test_times_that_are_none(arrays):
    time = arrays["time"].copy()
    time[7] = np.nan
    with pytest.raises(ConfigurationError, match="the first one in row 7"):
        palpate.record(**{**arrays, "time": time})
    dates = np.datetime64("2026-01-01") + (1e9 * arrays["time"]).round().astype("timedelta64[ns]")
    assert np.diff(palpate.record(**{**arrays, "time": dates}).columns.time).tolist() == (
        np.diff(palpate.record(**arrays).columns.time).tolist()
    )


def test_what_is_no_record_is_told(tmp_path):
    with pytest.raises(ConfigurationError, match=r"a list is not a record: palpate\.read\(path\) makes one"):
        palpate.fit(["a.csv"], tip="sphere 5 mm")
    with pytest.raises(LogError, match=r"is a folder, and no log; read its files one by one"):
        palpate.read(tmp_path)


@pytest.mark.parametrize(
    ("name", "meant"), [("E", "elasticity"), ("eta", "viscosity"), ("elastcity", "elasticity"), ("fram", "frame")]
)
def test_what_a_fit_is_asked_for_in_other_words(fitted, name, meant):
    with pytest.raises(AttributeError, match=f"did you mean '{meant}'"):
        getattr(fitted, name)


def test_a_tip_is_a_part_words_or_a_table_of_a_pipeline(record, fitted):
    for tip in ({"type": "sphere", "radius": "5 mm"}, {"type": "sphere", "radius": 0.005}):
        assert palpate.fit(record, tip=tip, model="dr").elasticity.value == fitted.elasticity.value
    cone = {"type": "blunt-cone", "angle": "30 deg", "tip_radius": "1 mm"}
    words = palpate.fit(record, tip="blunt-cone 30 deg, tip_radius 1 mm", model="dr")
    assert palpate.fit(record, tip=cone, model="dr").elasticity.value == words.elasticity.value
    cone["tip_radius"] = "2 mm"  # its owner changes it
    assert palpate.fit(record, tip=cone, model="dr").elasticity.value != words.elasticity.value


@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        ({"model": "dr"}, "needs a tip"),
        ({"model": "doctor", "tip": Sphere(radius="5 mm")}, "no model 'doctor'"),
        ({"model": 3, "tip": Sphere(radius="5 mm")}, "3 is neither of kind model"),
        ({"tip": "sphere"}, "sphere needs its radius"),
        ({"tip": Sphere(radius=5)}, 'did you mean "5 mm"'),
        ({"tip": {"type": "flat", "radios": "5 mm"}}, "radios"),
        ({"tip": {"radius": "5 mm"}}, "type"),
        ({"tip": {"type": "flat", "radius": object()}}, "cannot be written in a pipeline file"),
        ({"tip": Sphere(radius="5 mm"), "uncertainties": {"radios": "1 um"}}, "radios"),
    ],
)
def test_fits_that_cannot_be(record, arguments, what):
    with pytest.raises(ConfigurationError, match=what):
        palpate.fit(record, **arguments)


def test_a_record_that_is_gone(arrays):
    devices = palpate.record(**arrays, name="short-lived", sign=-1, tare="1 N").devices
    altered = {"record": {**devices["record"], "sha256": "0" * 64}}
    orphan = palpate.record(**arrays)
    with pytest.raises(ConfigurationError, match="not in the memory of this process"):
        palpate.fit(type(orphan)("gone", altered, orphan.alignment), tip=Sphere(radius="5 mm"))


# Sweeps and maps


@pytest.mark.slow
def test_a_sweep_is_a_frame(short):
    found = palpate.sweep(short.set("trajectory.press.duration", "0.3 s"), {"run.seed": range(2)}, jobs=1)
    frame = found.frame
    assert frame["run.seed"].tolist() == [0, 0, 1, 1]
    assert set(frame["track"]) == {"dr/ekf", "dr/kinematic"}
    assert not found.failures


@pytest.mark.slow
def test_a_sweep_of_a_script_does_not_run_the_script_again(short, tmp_path):
    import subprocess
    import sys

    script = tmp_path / "script.py"
    script.write_text(
        "import palpate\nprint('once')\n"
        f"draft = palpate.load({str(short.path)!r}).set('trajectory.press.duration', '0.2 s')\n"
        "print(len(palpate.sweep(draft.set('run.tracks', ['dr/ekf']), {'run.seed': [1, 2]}, jobs=2)))\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=240, cwd=tmp_path)
    assert done.stdout.split() == ["once", "2"], done.stderr


@pytest.mark.parametrize(
    ("settings", "more", "what"),
    [
        ({}, {}, "lists of values by setting"),
        ({"run.seed": []}, {}, "lists of values by setting"),
        ({"run.seed": [1], "run.average": ["1 s", "2 s"]}, {"combine": "list"}, "run.average has 2"),
        ({"run.sed": [1]}, {}, "sed"),
        ({"run.seed": [1]}, {"combine": "zip"}, "is not one of"),
    ],
)
def test_sweeps_that_cannot_be(short, settings, more, what):
    with pytest.raises(ConfigurationError, match=what):
        palpate.sweep(short, settings, **more)


@pytest.mark.slow
def test_a_raster_is_a_map(root, tmp_path):
    raster = palpate.load(root / "pipelines" / "raster.toml").set("trajectory.raster.size", ["8 mm", "4 mm"])
    run = raster.set("trajectory.raster.pitch", "4 mm").set("run.tracks", ["dr/kinematic"]).run()
    found = run.map(cell="2 mm", method="average")
    value = found.data["value"]
    assert value.dims == ("y", "x")
    assert value.attrs["units"] == "Pa"
    assert np.nanmedian(value) == pytest.approx(112e3, rel=0.3)  # nothing is told of the layer's thickness
    assert (found.data["std"] > 0).where(value.notnull(), True).all()
    assert list(found.lumps.columns) == ["x", "y", "contrast", "std", "p"]
    assert found.plot().save(tmp_path / "map.png").stat().st_size > 1000


def test_a_point_is_no_map(kept):
    with pytest.raises(LogError):
        kept.map()


def test_a_folder_that_is_no_run(tmp_path):
    with pytest.raises(LogError):
        palpate.open_run(tmp_path)


ARRAYS = {"force": np.ones(9), "height": np.linspace(1e-3, 0.0, 9)}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: palpate.record(time=np.arange(9.0), depth=np.ones(9), force=np.ones(9)), "write height=-depth"),
        (lambda: palpate.record(time=np.arange(9.0), force=np.ones(9)), "height"),
        (lambda: palpate.fit("a.csv", thickness="22 mm"), 'write rig={"thickness": "22 mm"}'),
        (lambda: palpate.fit("a.csv", mode="dr"), "no argument mode=; did you mean 'model'?"),
        (lambda: palpate.fit(), "fit: missing a required argument: 'record'; write fit(record)"),
        (lambda: palpate.prepare(tip="sphere 5 mm", rig={"thickness": "5 kPa"}), 'rig["thickness"]: '),
        (lambda: palpate.record(time=-np.arange(9.0), **ARRAYS), "time: runs backwards from the first reading"),
        (lambda: palpate.record(time=[0, 1, 2, 1, 4, 5, 6, 7, 8], **ARRAYS), "time: runs backwards at reading 3"),
        (lambda: palpate.record(rate=500, **ARRAYS | {"force": np.full(9, np.nan)}), "force: holds no number"),
    ],
)
def test_a_call_that_does_not_fit_says_what_to_write(call, words):
    with pytest.raises(ConfigurationError) as refused:
        call()
    assert words in str(refused.value)
    assert "--" not in str(refused.value)


def test_milliseconds_that_are_read_as_seconds_are_asked_about():
    with pytest.warns(UserWarning, match="is the time in ms"):
        record = palpate.record(time=2.0 * np.arange(9), **ARRAYS)
    assert 'units={"time": "ms"}' in record.doubts[0]
    assert not palpate.record(time=2.0 * np.arange(9), units={"time": "ms"}, **ARRAYS).doubts

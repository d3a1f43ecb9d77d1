"""Materiality: a flag is a doubt where it moves a value beyond its uncertainty, and of that value only."""

import math
from dataclasses import replace

import pytest
from palpate import Flag, FlagMeaning
from palpate.flags import judged_flags
from palpate.registry import load
from palpate_engine import UncertainValue
from palpate_engine.result.agreement import contradictions
from palpate_engine.result.materiality import weigh
from palpate_engine.result.track_result import TrackResult

REGISTRY = load()


def values(elasticity=None):
    return {
        "elasticity": elasticity or UncertainValue(100.0, 1.0, "Pa"),
        "viscosity": UncertainValue(10.0, 0.5, "Pa*s"),
    }


def test_each_value_is_judged_by_itself():
    weighed = weigh([Flag("velocity-late", "x", effects={"elasticity": 0.9, "viscosity": 0.6})], values(), REGISTRY)
    assert weighed.by_value == {"elasticity": "good", "viscosity": "doubtful"}
    (flag,) = weighed.findings
    assert "elasticity by 0.9 %, viscosity by 6 %" in flag.message


def test_what_moves_nothing_beyond_its_uncertainty_is_no_doubt():
    weighed = weigh([Flag("velocity-late", "x", effects={"elasticity": 0.9})], values(), REGISTRY)
    assert not weighed.findings
    assert [flag.code for flag in weighed.immaterial] == ["velocity-late"]


def test_a_larger_uncertainty_by_its_own_cause_makes_a_doubt_no_smaller():
    flag = Flag("tare-unclear", "x", effects={"elasticity": 3.0}, causes=("tare",))
    wide = UncertainValue(100.0, 1.0, "Pa").diagnosed("tare", 15.0)
    assert weigh([flag], values(elasticity=wide), REGISTRY).by_value["elasticity"] == "doubtful"
    by_another = UncertainValue(100.0, 1.0, "Pa").diagnosed("mass", 15.0)
    assert weigh([flag], values(elasticity=by_another), REGISTRY).by_value["elasticity"] == "good"


@pytest.mark.parametrize("effects", [None, {"elasticity": math.inf}])
def test_what_is_not_known_or_without_bound_counts(effects):
    assert weigh([Flag("velocity-late", "x", effects=effects)], values(), REGISTRY).by_value["elasticity"] == "doubtful"


def test_a_fault_of_the_record_counts_for_every_value():
    assert set(weigh([Flag("saturated", "x")], values(), REGISTRY).by_value.values()) == {"doubtful"}


def test_a_value_that_a_flag_voids_is_none_while_others_stay():
    impossible = Flag("implausible", "x", effects={"viscosity": math.inf})
    assert weigh([impossible], values(), REGISTRY).by_value == {"elasticity": "good", "viscosity": "invalid"}
    elastic = Flag("implausible", "x", effects={"elasticity": math.inf, "viscosity": 1.0})
    assert weigh([elastic], values(), REGISTRY).by_value == {"elasticity": "invalid", "viscosity": "doubtful"}
    one = track("dr", 100.0)
    assert replace(one, flags=(elastic,)).judged(REGISTRY, ()).verdict == "invalid"


def test_a_value_within_two_uncertainties_of_none_is_not_determined():
    for u, verdict in ((49.0, "good"), (51.0, "not determined")):
        weighed = weigh([], values(elasticity=UncertainValue(100.0, 1.0, "Pa", u)), REGISTRY)
        assert weighed.by_value == {"elasticity": verdict, "viscosity": "good"}
    (note,) = weighed.findings
    assert (note.code, note.severity) == ("undetermined", "note")
    assert "at most 0.202 kPa; most of its ± is what the estimate may still move" in note.message


@pytest.mark.parametrize(
    ("viscosity", "verdict"),
    [(UncertainValue(10.0, 20.0, "Pa*s"), "not determined"), (UncertainValue(10.0, 0.5, "Pa*s"), "doubtful")],
)
def test_a_track_has_the_word_of_its_elasticity_and_each_value_its_own(viscosity, verdict):
    """A viscosity that is doubtful made the row so, and a delay that was stated with it."""
    one = track("dr", 100.0)
    doubt = Flag("velocity-late", "x", effects={"viscosity": 50.0})
    both = replace(one, parameters={**one.parameters, "viscosity": viscosity}, flags=(doubt,)).judged(REGISTRY, ())
    assert both.verdict == both.parameters["elasticity"].verdict == "good"
    assert both.parameters["viscosity"].verdict == verdict
    assert all(flag.moves == ("viscosity",) for flag in both.flags if flag.code == "velocity-late")
    other = replace(one, parameters={"stiffness": one.parameters["elasticity"], "viscosity": viscosity}, flags=(doubt,))
    assert other.judged(REGISTRY, ()).verdict == ("good" if verdict == "not determined" else "doubtful")
    none = replace(one, parameters={"viscosity": UncertainValue(10.0, 20.0, "Pa*s")}).judged(REGISTRY, ())
    assert none.verdict == "not determined"


def test_how_places_of_a_sweep_differ_is_no_doubt():
    swept = UncertainValue(100.0, 1.0, "Pa").diagnosed("places", 60.0)
    assert not weigh([], values(elasticity=swept), REGISTRY).findings


def test_a_value_of_unknown_uncertainty_is_not_determined():
    unknown = UncertainValue(100.0, 1.0, "Pa", unknown=True)
    assert weigh([], values(elasticity=unknown), REGISTRY).by_value["elasticity"] == "not determined"


def test_the_largest_comes_first_and_notes_last():
    flags = [
        Flag("touched-again", "x"),
        Flag("velocity-late", "x", effects={"elasticity": 2.0}),
        Flag("surface-mismatch", "x", effects={"elasticity": 5.0}),
        Flag("no-contact", "x"),
    ]
    found = [flag.code for flag in weigh(flags, values(), REGISTRY).findings]
    assert found == ["no-contact", "surface-mismatch", "velocity-late", "touched-again"]


def test_signs_of_one_cause_are_one_flag():
    signs = [
        Flag("misfit", "a"),
        Flag("elsewhere", "b", effects={"elasticity": 1.0}),
        Flag("lack-of-fit", "c", effects={"elasticity": 0.5, "viscosity": 2.0}),
    ]
    (flag,) = REGISTRY.judged(signs)
    assert (flag.code, flag.message, flag.severity) == ("lack-of-fit", "c", "doubtful")
    assert [sign.code for sign in flag.evidence] == ["misfit", "elsewhere"]
    assert flag.effects == {"elasticity": 1.0, "viscosity": 2.0}
    (alone,) = REGISTRY.judged(signs[:1])
    assert (alone.code, alone.message, alone.effects) == ("lack-of-fit", "a", None)


def test_a_sign_of_a_flag_that_is_not_installed_stands_by_itself():
    meanings = {"own": FlagMeaning("doubtful", "x.", "y.", evidence_of="elsewhere-registered")}
    (flag,) = judged_flags([Flag("own", "m")], meanings)
    assert (flag.code, flag.severity) == ("own", "doubtful")


def test_a_flag_survives_its_table():
    (flag,) = REGISTRY.judged(
        [Flag("elsewhere", "b", effects={"elasticity": math.inf, "viscosity": 2.0}), Flag("lack-of-fit", "c")]
    )
    assert Flag.of_table(flag.table()).table() == flag.table()
    assert flag.table()["effects"] == {"elasticity": None, "viscosity": 2.0}


def track(model, elasticity, verdict="good"):
    value = UncertainValue(elasticity, 1.0, "Pa")
    return TrackResult(model, "x", 1, {"elasticity": value}, value, 0.0, 1.0, (), 0.0, verdict=verdict)


def test_two_that_contradict_each_other_are_both_doubted_and_one_against_many_alone():
    two = {"dr/a": track("dr", 100.0), "dr/b": track("dr", 103.0)}
    assert set(contradictions(two)) == {"dr/a", "dr/b"}
    assert set(contradictions(two | {"dr/c": track("dr", 100.5)})) == {"dr/b"}
    assert contradictions(two)["dr/a"].effects == {"elasticity": pytest.approx(3.0)}


def test_other_models_and_doubtful_tracks_contradict_nobody():
    assert not contradictions({"dr/a": track("dr", 100.0), "layer/a": track("layer", 120.0)})
    assert not contradictions({"dr/a": track("dr", 100.0), "dr/b": track("dr", 120.0, "doubtful")})


def test_a_track_that_never_had_a_value_is_not_good():
    lost = track("dr", math.nan).judged(REGISTRY, ())
    assert lost.verdict == "invalid"
    assert [flag.code for flag in lost.flags] == ["no-estimate"]

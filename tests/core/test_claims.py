"""A name that several plugins claim: palpate keeps its own, and of others each is reached with its distribution."""

import json
import sys
import tomllib
from pathlib import Path

import pytest
from palpate import ConfigurationError, PluginError, hooks, registry
from palpate.first_versions import FIRST_VERSIONS
from palpate_engine import load_pipeline, resolved_text
from palpate_engine.config import file_version
from palpate_engine.config.tip_words import tip_table
from palpate_kit.jobs.job import Job, Parcel, PortablePipeline

TIP = """
from palpate import Indenter, plugin
from palpate.units import Length
class Flat(Indenter):
    '''A flat punch.'''
    radius: Length
    def contact_radius(self, depth):
        return self.radius + 0 * depth
@plugin
def palpate_indenters():
    return {names}
"""
OFFERS = {
    "command": ("palpate_commands", "run", "Command('math:sqrt', 'Nothing.')"),
    "flag": ("palpate_flags", "no-contact", "FlagMeaning('note', 'All is well.', 'Nothing.')"),
    "table": ("palpate_tables", "safety", "Own"),
    "diagnosis": ("palpate_diagnoses", None, "Diagnosis('math:sqrt')"),
    "report section": ("palpate_report_sections", None, "ReportSection('math:sqrt')"),
}
ONE_OF_EACH = """
from palpate import Command, Diagnosis, FlagMeaning, ReportSection, Settings, plugin
class Own(Settings):
    pass
@plugin
def {hook}():
    return {{{name!r}: {offer}}}
"""
OFFER = """
from palpate import {root}, plugin
@plugin
def palpate_offers():
    return {{{kind!r}: {{{name!r}: {root}('math:sqrt')}}}}
"""


@pytest.fixture
def install(tmp_path):
    """Install a distribution of a text into a folder for the import path; all in one folder."""
    site = tmp_path / "site"

    def make(name, text, version="1.0"):
        module = name.replace("-", "_")
        info = site / f"{module}-{version}.dist-info"
        info.mkdir(parents=True)
        (site / f"{module}.py").write_text(text)
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        (info / "entry_points.txt").write_text(f"[palpate]\n{module} = {module}\n")
        return str(site)

    return make


@pytest.fixture
def on_the_path(install, monkeypatch):
    """Install a distribution for this process; its modules are gone with the test."""
    before = set(sys.modules)

    def make(*arguments):
        monkeypatch.syspath_prepend(install(*arguments))

    yield make
    for name in sys.modules.keys() - before:
        if name.endswith("_lab"):
            del sys.modules[name]


def flat(*names):
    classes = ", ".join(f"{name!r}: type('Flat', (Flat,), {{'__module__': __name__}})" for name in names)
    return TIP.format(names="{" + classes + "}")


def test_a_shipped_tip_stays_and_that_of_a_third_party_has_its_distribution(palpate, install, point_pipeline):
    site = install("soft-lab", flat("sphere", "punch"))
    done = palpate("check", point_pipeline, PYTHONPATH=site)
    assert done.returncode == 0, done.stderr
    sentence = (
        "plugin soft-lab 1.0 (soft_lab): indenter 'sphere' is a name of palpate's own; this one is 'soft-lab:sphere'"
    )
    assert done.stderr.count(sentence) == 1
    other = palpate("check", point_pipeline, "--json", "--set", "indenter.tip.type=soft-lab:sphere", PYTHONPATH=site)
    assert other.returncode == 0, other.stderr
    resolved = json.loads(other.stdout)["resolved"]
    assert resolved["indenter"]["tip"] == {"type": "soft-lab:sphere", "radius": 0.005}
    assert resolved["run"]["distributions"] == ["soft-lab 1.0"]
    short = palpate("check", point_pipeline, "--json", "--set", "indenter.tip.type=punch", PYTHONPATH=site)
    assert json.loads(short.stdout)["resolved"]["indenter"]["tip"]["type"] == "soft-lab:punch"
    assert palpate("describe", "Soft_Lab:sphere", PYTHONPATH=site).stdout.startswith(
        "soft-lab:sphere: a type of [indenter"
    )


def test_a_tip_in_words_follows_the_rule_of_names(on_the_path):
    own_words = flat("punch").replace("    radius: Length", "    word: ClassVar[str] = 'cone'\n    radius: Length")
    on_the_path("soft-lab", f"from typing import ClassVar\n{own_words}")
    known = registry.load()
    assert tip_table("Soft_Lab:punch 2 mm", known) == {"type": "punch", "radius": "2 mm"}
    assert tip_table("cone 30 deg", known)["type"] == "cone"
    on_the_path("hard-lab", flat("punch"))
    with pytest.raises(ConfigurationError, match="write 'hard-lab:punch' or 'soft-lab:punch'"):
        tip_table("punch 2 mm", registry.load())
    assert tip_table("hard-lab:punch 2 mm", registry.load())["type"] == "hard-lab:punch"
    with pytest.raises(ConfigurationError, match="the distribution warm-lab is not installed"):
        tip_table("warm-lab:punch 2 mm", registry.load())


def test_a_name_of_two_third_parties_is_refused_only_where_it_is_used(palpate, install, point_pipeline):
    install("soft-lab", flat("punch"))
    site = install("hard-lab", flat("punch"))
    sentence = (
        "indenter 'punch' is claimed by hard-lab 1.0 (hard_lab) and soft-lab 1.0 (soft_lab); "
        "write 'hard-lab:punch' or 'soft-lab:punch'"
    )
    listed = palpate("list", PYTHONPATH=site)
    assert listed.returncode == 0
    assert sentence in listed.stderr
    assert "hard-lab:punch" in listed.stdout
    assert palpate("check", point_pipeline, PYTHONPATH=site).returncode == 0
    used = palpate("check", point_pipeline, "--set", "indenter.tip.type=punch", PYTHONPATH=site)
    assert used.returncode == 2
    assert sentence in used.stderr
    exact = palpate("check", point_pipeline, "--set", "indenter.tip.type=soft-lab:punch", PYTHONPATH=site)
    assert exact.returncode == 0, exact.stderr


@pytest.mark.parametrize("kind", OFFERS)
def test_what_is_shipped_is_not_replaced(on_the_path, kind):
    before = registry.load()
    field = {"command": "commands", "flag": "flags", "table": "tables", "diagnosis": "diagnoses"}
    name = OFFERS[kind][1] or next(iter(getattr(before, field.get(kind, "report_sections"))))
    hook, _, offer = OFFERS[kind]
    on_the_path("soft-lab", ONE_OF_EACH.format(hook=hook, name=name, offer=offer))
    after = registry.load()
    for one in (*field.values(), "report_sections"):
        shipped = {key: offer for key, offer in getattr(after, one).items() if not key.startswith("soft-lab:")}
        assert list(shipped) == list(getattr(before, one))
    if name in getattr(before, field.get(kind, "report_sections")) and kind != "flag":
        assert (
            getattr(after, field.get(kind, "report_sections"))[name]
            == getattr(before, field.get(kind, "report_sections"))[name]
        )
    assert after.meanings == before.meanings
    (notice,) = after.oddities
    assert f"{kind} {name!r} is a name of palpate's own" in notice


@pytest.mark.parametrize(("kind", "field", "root"), [(kind, *names) for kind, names in hooks.OFFERS.items()])
def test_an_offer_of_palpate_comes_first_and_is_not_replaced(on_the_path, kind, field, root):
    before = getattr(registry.load(), field)
    names = ["aaa", *list(before)[:1]]
    on_the_path("aaa-lab", OFFER.format(root=root.__name__, kind=kind, name=names[-1]))
    on_the_path("bbb-lab", OFFER.format(root=root.__name__, kind=kind, name="aaa"))
    after = getattr(registry.load(), field)
    assert list(after) == [*before, "aaa"]
    assert {name: after[name] for name in before} == before


def test_a_command_of_a_taken_name_has_its_distribution(palpate, install, tmp_path):
    command = "from palpate import Command, plugin\ndef call() -> None:\n    print('of soft-lab')\n"
    command += "@plugin\ndef palpate_commands():\n    return {'run': Command('soft_lab:call', 'My own run.')}\n"
    install("hard-lab", command.replace("'run'", "'measure'"))
    install("warm-lab", command.replace("'run'", "'measure'"))
    site = install("soft-lab", command)
    assert "soft-lab:run" in palpate("--help", PYTHONPATH=site).stdout
    assert palpate("soft-lab:run", PYTHONPATH=site).stdout == "of soft-lab\n"
    assert "Run a pipeline" in palpate("run", "--help", PYTHONPATH=site).stdout
    ambiguous = palpate("measure", PYTHONPATH=site)
    assert ambiguous.returncode == 2
    assert "write 'hard-lab:measure' or 'warm-lab:measure'" in ambiguous.stderr


def test_a_file_that_claims_a_shipped_name_is_a_mistake_of_its_user(palpate, point_pipeline):
    (point_pipeline.parent / "own.py").write_text(flat("sphere"))
    done = palpate("check", point_pipeline, "--set", 'run.plugins=["own.py"]')
    assert done.returncode == 2
    assert "indenter 'sphere' is claimed by two plugins: palpate" in done.stderr


def test_a_file_and_a_distribution_of_one_name(palpate, install, point_pipeline):
    site = install("soft-lab", flat("punch"))
    (point_pipeline.parent / "own.py").write_text(flat("punch"))
    words = ("check", point_pipeline, "--set", 'run.plugins=["own.py"]', "--set")
    assert palpate(*words, "indenter.tip.type=own:punch", PYTHONPATH=site).returncode == 0
    ambiguous = palpate(*words, "indenter.tip.type=punch", PYTHONPATH=site)
    assert ambiguous.returncode == 2
    assert (
        "write 'own:punch' or 'soft-lab:punch'" in ambiguous.stderr
        or "'soft-lab:punch' or 'own:punch'" in ambiguous.stderr
    )


def test_initials_of_a_shipped_model_are_not_taken(on_the_path, point_pipeline):
    assert registry.load().named("model", "dr") == "dimensionality-reduction"
    text = "from palpate import plugin\n@plugin\ndef palpate_models():\n    return {'deep-rain': 'nowhere:DeepRain'}\n"
    on_the_path("soft-lab", text)
    assert registry.load().named("model", "dr") == "dimensionality-reduction"


class TestUpgrade:
    """A version of palpate that adds a name which an installed distribution has had before."""

    @pytest.fixture(autouse=True)
    def upgrade(self, monkeypatch, on_the_path):
        on_the_path("soft-lab", flat("sphere"))
        monkeypatch.setitem(FIRST_VERSIONS, ("indenter", "sphere"), "0.3")
        monkeypatch.setattr(file_version, "FORMAT", "0.3")

    def test_an_older_pipeline_means_the_part_of_the_third_party(self, point_pipeline):
        text = point_pipeline.read_text()
        assert 'palpate = "' not in text
        assert type(load_pipeline(point_pipeline).indenters["tip"]).__name__ == "Sphere"
        point_pipeline.write_text(f'palpate = "0.2"\n{text}')
        pipeline = load_pipeline(point_pipeline)
        assert type(pipeline.indenters["tip"]).__name__ == "Flat"
        (sentence,) = pipeline.registry.older_names
        assert sentence.startswith("indenter 'sphere' is new in palpate 0.3, and the pipeline is of 0.2: it means")
        resolved = tomllib.loads(resolved_text(pipeline))
        assert resolved["indenter"]["tip"]["type"] == "soft-lab:sphere"

    def test_palpate_is_meant_where_its_distribution_is_named(self, point_pipeline):
        point_pipeline.write_text(f'palpate = "0.2"\n{point_pipeline.read_text()}')
        pipeline = load_pipeline(point_pipeline, ["indenter.tip.type=palpate:sphere"])
        assert type(pipeline.indenters["tip"]).__module__.startswith("palpate_models")


def test_a_motion_of_a_new_name_is_refused_in_an_older_pipeline(on_the_path, point_pipeline, monkeypatch):
    (motion,) = load_pipeline(point_pipeline).trajectories.values()
    name = registry.load().name_of(type(motion))
    target = f"{type(motion).__module__}:{type(motion).__name__}"
    on_the_path(
        "soft-lab",
        f"from palpate import plugin\n@plugin\ndef palpate_trajectories():\n    return {{{name!r}: {target!r}}}\n",
    )
    monkeypatch.setitem(FIRST_VERSIONS, ("trajectory", name), "0.3")
    monkeypatch.setattr(file_version, "FORMAT", "0.3")
    assert load_pipeline(point_pipeline)
    point_pipeline.write_text(f'palpate = "0.2"\n{point_pipeline.read_text()}')
    with pytest.raises(ConfigurationError, match=f"write 'soft-lab:{name}' or 'palpate:{name}'"):
        load_pipeline(point_pipeline)


def test_the_part_of_a_distribution_that_is_missing_is_never_anothers(point_pipeline, on_the_path):
    on_the_path("soft-lab", flat("punch"))
    with pytest.raises(
        ConfigurationError, match=r"no indenter 'hard-lab:punch': the distribution hard-lab is not installed"
    ):
        load_pipeline(point_pipeline, ["indenter.tip.type=hard-lab:punch"])


@pytest.mark.slow
def test_a_replay_states_another_version_and_result_and_log_the_one_that_was_used(
    palpate, install, point_pipeline, tmp_path
):
    site = install("soft-lab", flat("punch"))
    short = ["--set", "trajectory.press.duration=2 s", "--set", 'run.tracks=["dr/ekf"]']
    words = ("run", point_pipeline, "--out", tmp_path / "out", *short, "--set", "indenter.tip.type=punch")
    done = palpate(*words, PYTHONPATH=site)
    assert done.returncode == 0, done.stderr
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    assert document["run"]["versions"]["soft-lab"] == "1.0"
    newer = tmp_path / "newer"
    (tmp_path / "site").rename(newer)
    (newer / "soft_lab-1.0.dist-info").rename(newer / "soft_lab-1.1.dist-info")
    (newer / "soft_lab-1.1.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: soft-lab\nVersion: 1.1\n")
    again = palpate("replay", tmp_path / "out", "--out", tmp_path / "again", PYTHONPATH=str(newer))
    assert again.returncode == 0, again.stderr
    flags = json.loads((tmp_path / "again" / "result.json").read_text())["tracks"]["dr/ekf"]["flags"]
    texts = [flag["message"] for flag in flags if flag["code"] == "device"]
    assert texts == ["resolved with soft-lab 1.0, and soft-lab 1.1 is installed"]
    without = palpate("replay", tmp_path / "out", "--out", tmp_path / "third")
    assert without.returncode == 2
    assert "the distribution soft-lab is not installed" in without.stderr


@pytest.mark.parametrize("switch", ["off", "hard_lab", "hard-lab, nothing-lab"])
def test_distributions_that_take_no_part(palpate, install, point_pipeline, switch):
    install("hard-lab", flat("anvil"))
    site = install("soft-lab", flat("punch"))
    listed = palpate("list", PYTHONPATH=site, PALPATE_PLUGINS=switch)
    assert listed.returncode == 0, listed.stderr
    assert ("anvil" in listed.stdout) == (switch != "off")
    assert "punch" not in listed.stdout
    assert "sphere" in listed.stdout
    assert f"plugin soft-lab 1.0 (soft_lab) is left out: PALPATE_PLUGINS is {switch!r}" in listed.stderr
    assert ("PALPATE_PLUGINS names 'nothing-lab', which is not installed" in listed.stderr) == ("nothing" in switch)
    wrong = palpate(
        "check", point_pipeline, "--set", "indenter.tip.type=soft-lab:punch", PYTHONPATH=site, PALPATE_PLUGINS=switch
    )
    assert wrong.returncode == 2
    assert "the distribution soft-lab is not installed, or left out" in wrong.stderr
    assert "; plugin soft-lab 1.0 (soft_lab) is left out" in wrong.stderr


def test_what_was_left_out_stands_in_the_notes_of_a_run(on_the_path, run_point, monkeypatch):
    on_the_path("soft-lab", flat("punch"))
    monkeypatch.setenv("PALPATE_PLUGINS", "off")
    result = run_point("trajectory.press.duration=1 s")
    sentence = "plugin soft-lab 1.0 (soft_lab) is left out: PALPATE_PLUGINS is 'off'"
    assert sentence in [flag.message for flag in result.flags if flag.code == "device"]


@pytest.mark.parametrize("switch", ["", "off", "hard-lab"])
def test_a_worker_has_the_distributions_of_where_its_job_was_made(
    on_the_path, point_pipeline, tmp_path, monkeypatch, switch
):
    """In an environment of its own that says otherwise."""
    on_the_path("soft-lab", flat("punch"))
    plan = PortablePipeline(point_pipeline.read_text(), point_pipeline, ("indenter.tip.type=punch",), named=True)
    monkeypatch.setenv("PALPATE_PLUGINS", switch)
    parcel = Parcel.of(Job("one", plan, tmp_path / "one"))
    monkeypatch.setenv("PALPATE_PLUGINS", "soft-lab" if switch else "off")
    with parcel.unpacked() as job:
        if switch:
            with pytest.raises(ConfigurationError, match=r"no indenter 'punch'.*PALPATE_PLUGINS is"):
                job.pipeline()
        else:
            assert type(job.pipeline().indenters["tip"]).__name__ == "Flat"


def test_a_name_holds_no_colon(on_the_path):
    on_the_path("soft-lab", flat("palpate:sphere"))
    (failure,) = registry.load().failures.values()
    assert "offers 'palpate:sphere', which is not a name" in failure


def test_every_new_name_states_its_version():
    parts = registry.load().parts
    shipped = {(kind, name) for kind in parts for name, entry in parts[kind].items() if entry.plugin.own}
    of_version = json.loads((Path(__file__).parent / "names_of_0.2.json").read_text())
    released = {(kind, name) for kind, names in of_version.items() for name in names}
    remedy = "add a new name to names_of_0.2.json before 0.2.0 is released, and to first_versions.py afterwards"
    assert shipped - released == set(FIRST_VERSIONS), remedy


def test_a_taken_name_in_a_file_is_named_in_python(tmp_path):
    (tmp_path / "own.py").write_text(flat("sphere"))
    with pytest.raises(PluginError, match="indenter 'sphere' is claimed by two plugins"):
        registry.load([tmp_path / "own.py"])

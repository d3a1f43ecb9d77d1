"""A hook that raises, or answers anything but its kind: named, with plugin and cause, and the others work."""

import json

import pytest
from palpate import PluginError, hooks, registry

HOOKS = sorted(name for name in vars(hooks) if name.startswith("palpate_"))
SENSOR = """
from palpate import ContactModel, FlagMeaning, Indenter, plugin
@plugin
def {hook}():
    {body}
"""
ANSWERS = {
    "raise KeyError('lost')": "{hook} raises KeyError: 'lost' ({file}, line 5)",
    "return [1]": "{hook} returns [1], not a",
    "return 1": "{hook} returns 1, not a",
}
OFFERS = {
    "return {'chek': {}}": "palpate_offers returns 'chek', which is not a kind of offer; did you mean 'check'?",
    "return {'check': 3}": "palpate_offers returns 3, not a mapping of names",
    "return {'check': {'own': 3}}": "palpate_offers offers 'own', which is not of kind Check",
}
ITEMS = {
    "return {3: Indenter}": "palpate_indenters offers 3, which is not a name",
    "return {'own': 3}": "palpate_indenters offers 'own', which is not of kind Indenter",
    "return {'own': Indenter}": "palpate_indenters offers 'own' (Indenter), which does not define contact_radius",
}


def hook_cases():
    """Each hook with each wrong answer of it."""
    cases = [(hook, body, words) for hook in HOOKS for body, words in ANSWERS.items()]
    cases += [("palpate_offers", body, words) for body, words in OFFERS.items()]
    return cases + [("palpate_indenters", body, words) for body, words in ITEMS.items()]


@pytest.fixture
def distribution(tmp_path):
    """Make a distribution "sensor 1.0" of a text; the folder for the import path."""

    def make(text):
        folder = tmp_path / "site"
        info = folder / "sensor-1.0.dist-info"
        info.mkdir(parents=True)
        (folder / "sensor_tips.py").write_text(text)
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: sensor\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text("[palpate]\nsensor = sensor_tips\n")
        return str(folder)

    return make


def test_there_are_as_many_hooks_as_are_tested():
    known = {hook for hook, _ in (*hooks.KINDS.values(), *hooks.EXTENSIONS.values())}
    assert set(HOOKS) == known | {"palpate_offers"}


@pytest.mark.parametrize(("kind", "field", "root"), [(kind, *names) for kind, names in hooks.OFFERS.items()])
def test_an_offer_of_each_kind_is_registered_and_its_former_hook_is_named(tmp_path, kind, field, root):
    assert f"``{kind}``" in hooks.palpate_offers.__doc__
    text = f"from palpate import {root.__name__}, plugin\n@plugin\ndef palpate_{{}}():\n    return {{}}\n"
    offer = f"{{'own': {root.__name__}('math:sqrt')}}"
    (tmp_path / "own.py").write_text(text.format("offers", f"{{{kind!r}: {offer}}}"))
    assert getattr(registry.load([tmp_path / "own.py"]), field)["own"] == root("math:sqrt")
    (tmp_path / "old.py").write_text(text.format(field, offer))
    (oddity, *_) = registry.load([tmp_path / "old.py"]).oddities
    assert oddity.endswith(f"palpate_{field} is not a hook: return it as {{{kind!r}: ...}} from palpate_offers")


@pytest.mark.parametrize(("hook", "body", "words"), hook_cases())
def test_a_hook_of_a_distribution_that_fails_is_named_and_the_others_work(
    palpate, distribution, point_pipeline, hook, body, words
):
    site = distribution(SENSOR.format(hook=hook, body=body))
    done = palpate("check", point_pipeline, PYTHONPATH=site)
    assert done.returncode == 0, done.stderr
    expected = words.format(hook=hook, file="sensor_tips.py")
    assert f"plugin sensor 1.0 (sensor): {expected}" in done.stderr
    assert done.stderr.count("sensor 1.0") == 1
    assert "is in order" in done.stdout


@pytest.mark.parametrize(("hook", "body", "words"), hook_cases())
def test_a_hook_of_a_file_that_fails_is_a_mistake_of_the_user(palpate, point_pipeline, hook, body, words):
    file = point_pipeline.parent / "own.py"
    file.write_text(SENSOR.format(hook=hook, body=body))
    done = palpate("check", point_pipeline, "--set", 'run.plugins=["own.py"]')
    assert done.returncode == 2
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"palpate: plugin {file}: {words.format(hook=hook, file='own.py')}")
    assert "Traceback" not in done.stderr


def test_what_needs_the_failed_hook_says_so(palpate, distribution, point_pipeline):
    text = "from palpate import plugin\n@plugin\ndef palpate_indenters():\n    1 / 0\n"
    text += "@plugin\ndef palpate_commands():\n    raise KeyError('lost')\n"
    site = distribution(text)
    cause = "plugin sensor 1.0 (sensor): palpate_indenters raises ZeroDivisionError: division by zero"
    wanted = palpate("check", point_pipeline, "--set", "indenter.tip.type=cone-of-theirs", PYTHONPATH=site)
    assert wanted.returncode == 2
    assert cause in wanted.stderr
    called = palpate("measure", PYTHONPATH=site)
    assert called.returncode == 2
    assert "no command 'measure'" in called.stderr
    assert "palpate_commands raises KeyError: 'lost' (sensor_tips.py, line 7)" in called.stderr
    assert "palpate_commands raises KeyError" in palpate("--help", PYTHONPATH=site).stdout
    told = json.loads(palpate("info", "--json", PYTHONPATH=site).stdout)["failures"]["sensor 1.0 (sensor)"]
    assert told.startswith(cause)
    assert "; palpate_commands raises KeyError" in told


def test_a_hook_that_asks_for_an_argument(distribution, palpate, point_pipeline):
    text = "from palpate import plugin\n@plugin\ndef palpate_devices(rate):\n    return {}\n"
    done = palpate("list", PYTHONPATH=distribution(text))
    assert done.returncode == 0, done.stderr
    assert "plugin sensor 1.0 (sensor) could not be loaded: PluginValidationError" in done.stderr
    file = point_pipeline.parent / "own.py"
    file.write_text(text)
    with pytest.raises(PluginError, match=r"own\.py could not be loaded: .*'rate'"):
        registry.load([file])


@pytest.mark.slow
def test_the_other_hooks_of_a_plugin_that_fails_work(palpate, distribution, point_pipeline):
    text = SENSOR.format(hook="palpate_models", body="1 / 0") + (
        "class Cone(Indenter):\n    '''A cone.'''\n    def contact_radius(self, depth):\n        return depth\n"
        "@plugin\ndef palpate_indenters():\n    return {'cone-of-theirs': Cone, 'late': 'sensor_late:Cone'}\n"
    )
    site = distribution(text)
    listed = palpate("list", PYTHONPATH=site)
    assert listed.returncode == 0, listed.stderr
    assert "cone-of-theirs" in listed.stdout
    assert "plugin sensor 1.0 (sensor): 'late': sensor_late:Cone cannot be imported" in listed.stderr
    schema = json.loads(palpate("describe", "schema", PYTHONPATH=site).stdout)
    assert "indenter:cone-of-theirs" in schema["$defs"]
    assert "indenter:late" not in schema["$defs"]
    assert (
        "cannot be imported"
        in palpate("check", point_pipeline, "--set", "indenter.tip.type=late", PYTHONPATH=site).stderr
    )


def test_a_check_that_raises_is_named(palpate, point_pipeline):
    (point_pipeline.parent / "own.py").write_text(
        "from palpate import Check, plugin\ndef judge(parts, registry):\n    1 / 0\n"
        "@plugin\ndef palpate_offers():\n    return {'check': {'own': Check(judge)}}\n"
    )
    done = palpate("check", point_pipeline, "--set", 'run.plugins=["own.py"]')
    assert done.returncode == 2
    assert "check 'own' raises ZeroDivisionError: division by zero" in done.stderr

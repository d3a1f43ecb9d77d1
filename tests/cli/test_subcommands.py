"""Commands of two words, and the help that names them."""

import re

import pytest
from palpate import PluginError
from palpate.offers import PANELS
from palpate.trust import with_plugin_files
from palpate_commands.completion import options_of
from palpate_engine import analysis, only_plugins
from palpate_engine.cli.commands import command_offers, help_text

with only_plugins("off"):  # whatever else is installed
    COMMANDS = command_offers().commands
TOP = {name.partition(" ")[0] for name, command in COMMANDS.items() if not command.hidden}


def test_the_help_fits_a_mind():
    """What a laboratory types every day, and little else."""
    assert len(TOP) <= 25
    daily = "run rehearse replay check init info fit map report plot calibrate doctor twin list describe"
    assert set(daily.split()) <= TOP


def test_palpate_alone_says_in_ten_lines_what_to_type_first(palpate):
    shown = palpate().stdout
    assert len(shown.splitlines()) <= 10
    assert max(map(len, shown.splitlines())) <= 100
    commands = re.findall(r"(?::|then) +palpate (\w+)", shown)
    assert {"fit", "info", "init", "run", "rehearse"} <= set(commands) <= TOP


def test_the_help_shows_every_word(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    words = help_text().replace(",", " ").replace(".", " ").replace(":", " ").split()
    for name, command in COMMANDS.items():
        assert (set(name.split()) <= set(words)) != command.hidden, name


def test_a_hidden_command_works(palpate, tmp_path):
    (tmp_path / "own.py").write_text("")
    assert palpate("trust", "own.py").returncode == 0
    assert str(tmp_path / "own.py") in palpate("trust").stdout


@pytest.mark.parametrize("words", [["check"], ["fit"], ["fit", "all"]], ids=" ".join)
def test_what_takes_no_value_shows_no_type(palpate, words):
    shown = palpate(words[0], "--help", *words[1:]).stdout
    assert "--help" in shown
    assert "bool" not in shown.lower()


@pytest.mark.parametrize(
    "gone", ["reproduce", "compare", "record", "resume", "watch", "plan", "teach", "control", "agree", "spectrum"]
)
def test_what_went_from_the_top_is_in_the_decision(palpate, root, gone):
    assert palpate(gone, "x").returncode == 2
    page = root / "docs" / "decisions" / "0417-one-word-for-what-is-done-to-one-thing.md"
    rows = page.read_text().partition("## Consequences")[2]
    assert f"`{gone}" in rows


def test_the_first_help_of_fit_has_ten_options_and_all_the_others_are_a_word_away(palpate):
    first, every = (shown_options(palpate("fit", "--help", *words).stdout) for words in ((), ("all",)))
    assert first == set(COMMANDS["fit"].first_options)
    assert len(first) == 10
    assert every == set(options_of("fit")) - {"--help"}
    assert "palpate fit --help all shows every option" in palpate("fit", "--help").stdout


def shown_options(text):
    return set(re.findall(r"^│ (--[a-z-]+)", text, re.MULTILINE)) - {"--help"}


@pytest.mark.parametrize(
    ("name", "option"), [(name, option) for name, command in COMMANDS.items() for option in command.former_options]
)
def test_a_former_option_is_refused_with_the_new_words(palpate, name, option):
    done = palpate(*name.split(), "press.csv", option)
    new = COMMANDS[name].former_options[option]
    assert done.returncode == 2
    assert done.stderr == f"palpate: {option}: palpate {name} {option} is {new} now\n"
    assert option not in options_of(name)
    command, _, other = new.removeprefix("palpate ").partition(" --")
    assert not other or f"--{other}" in options_of(command)
    assert command in COMMANDS


def test_the_help_of_a_command_shows_its_subcommands(palpate):
    shown = palpate("map", "--help").stdout
    assert "--cell" in shown
    assert "palpate map lumps: Find the lumps in a run" in shown
    assert "palpate map curves" not in palpate("map", "lumps", "--help").stdout


@pytest.mark.parametrize("words", [["log"], ["log", "--help"], ["log", "-h"]], ids=" ".join)
def test_a_first_word_without_a_command_shows_its_subcommands(palpate, words):
    done = palpate(*words)
    assert done.returncode == 0
    assert "A log as CSV" in done.stdout
    assert "recover" in done.stdout


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["log", "exprt", "x.mcap"], "'export'"),
        (["map", "lmups", "run"], "'lumps'"),
        (["lump", "run"], "'map lumps'"),
        (["exprot", "x.mcap"], "'log export'"),
        (["lg", "export"], "'log"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_slip_is_answered_with_what_was_meant(palpate, words, meant):
    done = palpate(*words)
    assert done.returncode == 2
    assert done.stdout == ""
    assert f"did you mean {meant}" in done.stderr


def test_a_word_far_from_any_subcommand_is_refused_where_there_is_no_other_use(palpate):
    done = palpate("model", "run.toml")
    assert done.returncode == 2
    assert "no command 'model run.toml' (there are: export, thickness)" in done.stderr


def test_a_file_named_like_a_slip_is_a_file(palpate, tmp_path):
    (tmp_path / "lumpy").mkdir()
    assert "not a run folder" in palpate("map", "lumpy", cwd=tmp_path).stderr


def test_a_subcommand_goes_before_a_folder_of_its_name(palpate, tmp_path):
    (tmp_path / "lumps").mkdir()
    assert "Missing argument" in palpate("map", "lumps", cwd=tmp_path).stderr
    assert "not a run folder" in palpate("map", "./lumps", cwd=tmp_path).stderr


def test_a_plugin_adds_to_another_ones_command(palpate, tmp_path):
    (tmp_path / "own.py").write_text(
        "from palpate import Command, plugin\n\n\n@plugin\ndef palpate_commands():\n"
        "    return {'map contour': Command('own:contour', 'Lines of one modulus.')}\n"
    )
    words = ("--plugin", tmp_path / "own.py", "map")
    assert "palpate map contour: Lines of one modulus." in palpate(*words, "--help").stdout
    done = palpate(*words, "contour", "run")
    assert done.returncode == 2
    assert "own:contour cannot be imported" in done.stderr


def test_the_first_word_of_several_is_no_analysis():
    with pytest.raises(PluginError, match=r"'model' is the first word of commands \(there are: export, thickness"):
        analysis("model")


def test_the_help_is_by_task_and_loses_no_command_of_a_stranger(tmp_path):
    offer = '{"odd": Command("x:y", "Odd.", "nothing")}'
    text = f"from palpate import Command, plugin\n\n\n@plugin\ndef palpate_commands():\n    return {offer}\n"
    (tmp_path / "odd.py").write_text(text)
    assert {command.panel for command in COMMANDS.values()} <= set(PANELS)
    with with_plugin_files([tmp_path / "odd.py"]):
        shown = help_text()
    titles = [line.removesuffix(":") for line in shown.splitlines() if line.endswith(":") and line[0] != " "]
    assert titles == list(PANELS.values())
    assert "  odd         Odd." in shown.partition("Look deeper:")[2].partition("\n\n")[0]


OWN = """
from palpate import Command, Indenter, Length, plugin
from pydantic import Field


class Ball(Indenter):
    '''A ball.'''

    radius: Length = Field(description="its radius")

    def contact_radius(self, depth):
        '''The root of a^2 / R = d.'''
        return (self.radius * depth) ** 0.5


def greet():
    '''Greet.'''
    print("good day")


@plugin
def palpate_indenters():
    return {"ball": Ball}


@plugin
def palpate_commands():
    return {"greet": Command(f"{__name__}:greet", "Greet.")}
"""


@pytest.mark.parametrize("behind", [False, True])
def test_a_plugin_file_is_as_if_installed_wherever_it_is_named(palpate, point_pipeline, tmp_path, behind):
    (tmp_path / "own.py").write_text(OWN)
    point_pipeline.write_text(point_pipeline.read_text().replace('type = "sphere"', 'type = "ball"'))
    for words, shown in (
        (("greet",), "good day"),
        (("describe", "ball"), "A ball."),
        (("list",), "A ball."),
        (("check", point_pipeline), "in order"),
    ):
        named = ("--plugin", tmp_path / "own.py")
        done = palpate(*words, *named) if behind else palpate(*named, *words)
        assert done.returncode == 0, done.stderr
        assert shown in done.stdout
    assert palpate("check", point_pipeline).returncode == 2


@pytest.mark.slow
def test_a_run_names_the_plugin_file_of_its_command(palpate, point_pipeline, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    text = point_pipeline.read_text().replace('type = "sphere"', 'type = "ball"')
    point_pipeline.write_text(text.replace('duration = "10 s"', 'duration = "2 s"'))
    run = palpate("run", point_pipeline, "--plugin", tmp_path / "own.py", "--out", tmp_path / "run")
    assert run.returncode == 0, run.stderr
    again = palpate("replay", tmp_path / "run", "--out", tmp_path / "again")
    assert again.returncode == 0, again.stderr


def test_a_misspelt_hook_is_named_where_its_command_is_missed(palpate, tmp_path):
    text = "from palpate import plugin\n\n\n@plugin\ndef palpate_comands():\n    return {}\n"
    (tmp_path / "own.py").write_text(text)
    done = palpate("--plugin", tmp_path / "own.py", "odd")
    assert done.returncode == 2
    assert "palpate_comands is not a hook; did you mean 'palpate_commands'?" in done.stderr
    done = palpate("describe", "odd", "--plugin", tmp_path / "own.py")
    assert "palpate_comands is not a hook" in done.stderr


def test_every_template_is_a_pipeline():
    """A link that became a text would be written for the user as it is."""
    from importlib.resources import files

    templates = [
        path for path in files("palpate_commands").joinpath("templates").iterdir() if path.name.endswith(".toml")
    ]
    assert len(templates) >= 5
    for path in templates:
        assert "[device." in path.read_text(encoding="utf-8"), path.name


def test_initials_name_a_part_in_a_pipeline_and_its_description(palpate, root, tmp_path):
    text = (root / "pipelines" / "point.toml").read_text()
    (tmp_path / "p.toml").write_text(text.replace('"dimensionality-reduction"', '"dr"'))
    resolved = palpate("check", tmp_path / "p.toml", "--resolved")
    assert resolved.stdout == palpate("check", root / "pipelines" / "point.toml", "--resolved").stdout
    shown = palpate("describe", "dr").stdout
    assert shown == palpate("describe", "dimensionality-reduction").stdout
    assert "did you mean" in palpate("describe", "dimensionality-reductio").stderr

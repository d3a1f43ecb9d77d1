"""No command executes a plugin file because a log or a run folder names it, unless its content was approved here."""

import importlib.util
import inspect
import os
import py_compile
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from palpate import OutputError, PluginError, open_run, read, trust
from palpate.offers import function_of
from palpate.plugin_switch import only_plugins
from palpate.registry import load_commands
from palpate_engine import write_whole
from palpate_engine.config import Source, build_pipeline, load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_kit.jobs.job import Job, Parcel, PortablePipeline, run_parcel
from palpate_kit.runs.continuation import recorded_pipeline

LINE = [
    'trajectory.sweep.start=["0 mm", "-22 mm"]',
    'trajectory.sweep.end=["0 mm", "-8 mm"]',
    "trajectory.sweep.settle=2 s",
    'run.tracks=["dr/kinematic"]',
]
CANARY = """import pathlib
pathlib.Path({trace!r}).touch()
from palpate import Indenter, Length, plugin
class Mine(Indenter):
    "A tip of one's own."
    radius: Length
    def contact_radius(self, depth):
        return (self.radius * depth) ** 0.5
@plugin
def palpate_indenters():
    return {{"mine": Mine}}
"""
REMEDY = "palpate trust "


def canary(folder, name="canary.py"):
    """A plugin file that leaves a trace when it is executed."""
    path = folder / name
    path.write_text(CANARY.format(trace=str(folder / "trace")))
    return path


@pytest.fixture(scope="module")
def made(tmp_path_factory, root):
    """A run along a line whose pipeline and log name a canary, without a hash; nothing has executed it."""
    place = tmp_path_factory.mktemp("made")
    pipeline = load_pipeline(root / "pipelines" / "sweep.toml", LINE)
    named = pipeline.run.model_copy(update={"plugins": (canary(place),)})
    run_pipeline(replace(pipeline, run=named), place / "run")
    run_pipeline(pipeline, place / "clean")
    shutil.copytree(place / "run", place / "bare", ignore=shutil.ignore_patterns("*.mcap"))
    shutil.copy(place / "run" / "log.mcap", place / "log.mcap")
    assert not (place / "trace").exists()
    return place


@pytest.fixture(autouse=True)
def nothing_is_approved(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(trust, "_PROCESS", trust._Consent())
    monkeypatch.setattr(trust, "_consent", trust.ContextVar("_consent", default=trust._PROCESS))


OUTPUTS = ("out", "output", "picture")
MORE = {  # what a command wants besides
    "model export": ["--track", "dr/kinematic"],
    "info": ["--suggest"],
    "plot": ["time"],
    "fit choose": ["--models", "dr,kelvin-voigt"],
    "fit compare": ["another.csv"],
}
ENDINGS = {"log export": "out.csv", "log recover": "out.mcap"}
KINDS = ("log", "run", "bare")
SLOW = ("map", "plot", "report")

# Which recordings a command refuses for the plugin file that they name; and which it reads without executing it.
ASKS = {
    ("fit choose", "runs"): "log run",
    ("model export", "file"): "log run",
    ("fit", "sources"): "log run",
    ("fit compare", "sources"): "log run",
    ("fit cycles", "sources"): "log run",
    ("fit indentation", "source"): "log run bare",
    ("info", "log"): "log run",
    ("fit relaxation", "run"): "log run bare",
    ("repeat", "sources"): "log",
    ("replay", "source"): "log run",
    ("run resume", "run"): "run bare",
    ("map search", "run"): "run bare",
    ("fit spectrum", "runs"): "log run bare",
    ("replay watch", "source"): "log run",
    ("map", "run"): "log",
}
READS = {
    ("report budget", "run"): "run bare",
    ("map curves", "runs"): "run bare",
    ("log export", "log"): "log run",
    ("map lumps", "run"): "run bare",
    ("map", "run"): "run bare",
    ("plot", "run"): "run bare",
    ("log recover", "log"): "log",
    ("report", "runs"): "run bare",
    ("repeat review", "runs"): "run bare",
    ("repeat", "sources"): "run bare",
    ("replay watch", "source"): "bare",
}


def inputs():
    """Every argument of every command that takes a file to be read, as it is written on the command line."""
    with only_plugins("off"):  # whatever else is installed
        commands = load_commands().commands
    for name, command in commands.items():
        parameters = list(inspect.signature(function_of(command), eval_str=True).parameters.values())
        files = [one for one in parameters if "Path" in str(one.annotation) and one.name not in (*OUTPUTS, "plugin")]
        for one in files:
            others = [other for other in files if other is not one and other.default is other.empty]
            out = any(other.name == "out" and other.default is other.empty for other in parameters)
            yield pytest.param(name, one, others, out, id=f"{name}-{one.name}")


def words(parameter, value):
    (information,) = parameter.annotation.__metadata__
    flags = [] if type(information).__name__ == "ArgumentInfo" else [*(information.param_decls or ())]
    is_option = type(information).__name__ == "OptionInfo"
    return [*([next(iter(flags), f"--{parameter.name}")] if is_option else []), str(value)]


@pytest.mark.parametrize(("name", "parameter", "others", "out"), list(inputs()))
def test_no_command_executes_what_a_recording_names(made, palpate, tmp_path, monkeypatch, name, parameter, others, out):
    """A new command that takes recordings belongs into one of the two tables."""

    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(
        "palpate_live.server_process.PageServer.wait", interrupted
    )  # the page of `watch` waits for Ctrl-C
    for kind in KINDS[:2] if name in SLOW or parameter.name == "points" else KINDS:
        source = made / ("log.mcap" if kind == "log" else kind)
        rest = [word for other in others for word in words(other, made / "clean")]
        rest += ["--out", tmp_path / kind / ENDINGS.get(name, "out")] if out else []
        (tmp_path / kind).mkdir()
        done = palpate(*name.split(), *words(parameter, source), *rest, *MORE.get(name, []), cwd=tmp_path / kind)
        assert not (made / "trace").exists()
        assert "Traceback" not in done.stderr
        key = (name, parameter.name)
        if kind in ASKS.get(key, "").split():
            assert done.returncode == 2, done.stderr
            assert f"{REMEDY}{made}/canary.py" in done.stderr
        elif kind in READS.get(key, "").split():
            assert done.returncode == 0, done.stderr
            assert REMEDY not in done.stderr
        else:
            assert done.returncode == 2, (kind, done.stdout, done.stderr)  # takes none such, or not of a line
            assert REMEDY not in done.stderr


@pytest.mark.parametrize(
    "line",
    [
        "report budget RUN --monte-carlo 100",
        "fit choose LOG --models dimensionality-reduction,kelvin-voigt",
        "info LOG --suggest --force /rig/wrench:wrench.force.z -o own.toml",
        "replay LOG --add-model kelvin-voigt",
        "map search RUN --go",
        "fit LOG LOG --set estimator.fit.type=casadi-fit",
        "repeat --group a=LOG",
    ],
)
def test_no_option_executes_it_either(made, palpate, line):
    done = palpate(*line.replace("RUN", str(made / "run")).replace("LOG", str(made / "log.mcap")).split())
    assert done.returncode == 2
    assert REMEDY in done.stderr
    assert not (made / "trace").exists()


def hostile(log, folder, text, sha256=None):
    """A copy of a log whose pipeline lists plugin files as a text of TOML, with a hash of canary.py or without."""
    from mcap.reader import make_reader
    from mcap.writer import Writer

    folder.mkdir(exist_ok=True)
    with log.open("rb") as source, (folder / "log.mcap").open("wb") as target:
        reader, writer = make_reader(source), Writer(target)
        writer.start()
        for attachment in reader.iter_attachments():
            data = attachment.data
            if attachment.name.endswith(".toml"):
                data = re.sub(rb"plugins = \[[^]]*\]", f"plugins = {text}".encode(), data)
            writer.add_attachment(
                attachment.create_time, attachment.log_time, attachment.name, attachment.media_type, data
            )
        for metadata in reader.iter_metadata():
            facts = {key: value for key, value in metadata.metadata.items() if not key.startswith("plugin.")}
            facts |= {"plugin.canary.py.sha256": sha256} if sha256 else {}
            writer.add_metadata(metadata.name, facts)
        schemas, channels = {}, {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if schema.id not in schemas:
                schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
            if channel.id not in channels:
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, schemas[schema.id], channel.metadata
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence
            )
        writer.finish()
    return folder / "log.mcap"


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize("with_hash", [False, True])
def test_the_remedy_approves_this_content_and_no_other(made, palpate, tmp_path, with_hash):
    """The hash in a log, which its author writes, approves nothing."""
    own = canary(tmp_path)
    digest = trust.PluginFile.read(own).digest
    log = hostile(made / "log.mcap", tmp_path / "log", f'["{own}"]', digest if with_hash else None)
    refused = palpate("replay", log)
    assert refused.returncode == 2
    assert (
        f"its content has never been approved here, so it is not executed; read it, then approve it: {REMEDY}{own}"
        in (refused.stderr)
    )
    assert palpate("trust").stdout == ""
    assert palpate("trust", own).stdout == palpate("trust").stdout == f"{digest}  {own}\n"
    assert not (tmp_path / "trace").exists()
    done = palpate("replay", log, "--out", tmp_path / "again")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count(f"executing plugin file {own}") == 1
    assert (tmp_path / "trace").exists()
    (tmp_path / "trace").unlink()
    own.write_text(own.read_text() + "# changed\n")
    changed = palpate("replay", log)
    assert changed.returncode == 2
    assert ("another version of the plugin file" if with_hash else REMEDY) in changed.stderr
    assert not (tmp_path / "trace").exists()


def test_what_a_named_pipeline_has_executed_here_is_approved(palpate, point_pipeline, tmp_path):
    canary(tmp_path)
    sets = [
        "--set",
        'run.plugins=["canary.py"]',
        "--set",
        'run.tracks=["dr/ekf"]',
        "--set",
        "trajectory.press.duration=1 s",
    ]
    assert palpate("run", point_pipeline, *sets, "--out", tmp_path / "run").returncode == 0
    shutil.move(tmp_path / "canary.py", tmp_path / "elsewhere.py")
    text = (tmp_path / "run" / "pipeline.toml").read_text()
    (tmp_path / "run" / "pipeline.toml").write_text(text.replace("canary.py", "elsewhere.py"))
    resumed = palpate("run", "resume", tmp_path / "run")  # known by its content
    assert resumed.returncode == 0, resumed.stderr
    assert palpate("--no-plugins", "run", "resume", tmp_path / "run").returncode == 2


def test_a_file_that_the_command_line_chooses_is_the_users(made, palpate, tmp_path):
    own = canary(tmp_path)
    done = palpate("replay", made / "log.mcap", "--set", f'run.plugins=["{own}"]', "--out", "out")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "trace").exists()
    assert not (made / "trace").exists()


@pytest.mark.gate
@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('["canary.py"]', "is not on this machine"),  # it is in the current folder, and the log is not
        ('["../log/../here/canary.py"]', REMEDY),
        ('["link.py"]', REMEDY),
        ('["~nobody-of-this-name/canary.py"]', "is not on this machine"),
        ('["canary"]', "is not on this machine"),  # as a module
        ('["palpate_models"]', "is not on this machine"),
        ('["."]', "is not on this machine"),
        ('["canary.so"]', "is not a Python file"),
        ('["/dev/stdin"]', "is not on this machine"),
        ('"canary.py"', "must be a list"),
        ("[1]", "[run] plugins.0: 1: must be"),
    ],
)
def test_paths_in_a_log(made, palpate, tmp_path, text, message):
    here = tmp_path / "here"
    here.mkdir()
    own = canary(here)
    log = hostile(made / "log.mcap", tmp_path / "log", text)
    (tmp_path / "log" / "link.py").symlink_to(own)
    shutil.copy(own, tmp_path / "log" / "canary.so")
    for command in ("replay", "fit", "info"):
        done = palpate(command, log, *MORE.get(command, []), cwd=here)
        assert done.returncode == 2, done.stderr
        assert message in done.stderr
        assert not (here / "trace").exists()


@pytest.mark.gate
@pytest.mark.slow
def test_a_calibration_in_a_log_is_looked_up_beside_it(made, palpate, tmp_path):
    log = hostile(made / "log.mcap", tmp_path / "log", '[]\ncalibration = "mine.toml"')
    (tmp_path / "mine.toml").write_text("not a calibration")
    done = palpate("replay", log, "--out", "out")
    assert done.returncode == 0, done.stderr


def test_a_copied_run_folder_with_a_plugin_beside_its_pipeline(made, palpate, tmp_path):
    run = tmp_path / "copied"
    shutil.copytree(made / "bare", run)
    canary(run)
    text = re.sub(r"plugins = \[[^]]*\]", 'plugins = ["canary.py"]', (run / "pipeline.toml").read_text())
    (run / "pipeline.toml").write_text(text)
    for command in ("run resume", "map search", "fit spectrum", "fit indentation", "fit relaxation"):
        done = palpate(*command.split(), "copied")
        assert done.returncode == 2
        assert f"{REMEDY}copied/canary.py" in done.stderr
    (tmp_path / "there").symlink_to(run)
    assert REMEDY in palpate("run", "resume", "there").stderr
    assert not (run / "trace").exists()


def test_python_executes_no_more_than_a_command(made):
    read(made / "log.mcap")  # of which it takes signals and alignment only
    for attempt in (open_run(made / "run").replay, lambda: recorded_pipeline(made / "bare")):
        with pytest.raises(PluginError, match=r"palpate trust .* \(in Python: palpate_engine\.trust_plugin\)"):
            attempt()
    assert not (made / "trace").exists()


def test_in_python_too_a_file_that_is_named_is_executed_and_approved(point_pipeline, tmp_path):
    canary(tmp_path)
    load_pipeline(point_pipeline, ['run.plugins=["canary.py"]'])
    assert (tmp_path / "trace").exists()
    assert list(trust.trusted_plugins().values()) == [str(tmp_path / "canary.py")]
    text = point_pipeline.read_text().replace("[run]\n", '[run]\nplugins = ["canary.py"]\n', 1)
    assert build_pipeline(Source(text, point_pipeline)).run.plugins == (tmp_path / "canary.py",)


def test_what_is_hashed_is_executed(tmp_path, monkeypatch):
    """Neither compiled code beside the file, nor what is put in its place meanwhile."""
    own = canary(tmp_path)
    own.write_text("value = 1\n")
    evil = canary(tmp_path, "evil.py")
    compiled = Path(importlib.util.cache_from_source(str(own)))
    py_compile.compile(str(evil), str(compiled), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
    trust.trust_plugin(own)
    (file,) = trust.approved_files([own], tmp_path / "log.mcap", named=False)
    own.write_bytes(evil.read_bytes())
    from palpate import registry

    (plugin,) = [plugin for plugin in registry.load([file]).plugins if plugin.name == str(own)]
    assert plugin.digest == file.digest
    assert not (tmp_path / "trace").exists()


def with_plugin(pipeline):
    text = pipeline.read_text().replace('duration = "10 s"', 'duration = "1 s"')
    return text.replace("[run]\n", '[run]\nplugins = ["canary.py"]\ntracks = ["dr/ekf"]\n', 1)


@pytest.mark.parametrize("decided", [True, False])
def test_a_worker_executes_what_was_decided_and_decides_nothing(point_pipeline, tmp_path, monkeypatch, decided):
    """Not even what this machine has a record of."""
    own = canary(tmp_path)
    parcel = Parcel.of(
        Job("one", PortablePipeline(with_plugin(point_pipeline), point_pipeline, named=decided), tmp_path / "one")
    )
    assert (trust.PluginFile.read(own).digest in parcel.approved) == decided
    trust.trust_plugin(own)
    outcome = run_parcel(parcel)
    assert (tmp_path / "trace").exists() == decided
    assert isinstance(outcome, PluginError) != decided


@pytest.mark.parametrize("written", [True, False])
def test_a_worker_does_not_execute_a_file_that_was_changed_meanwhile(point_pipeline, tmp_path, written):
    own = canary(tmp_path)
    text = with_plugin(point_pipeline)
    point_pipeline.write_text(text)
    plan = PortablePipeline(text, point_pipeline, named=True) if written else load_pipeline(point_pipeline)
    parcel = Parcel.of(Job("one", plan, tmp_path / "one"))
    (tmp_path / "trace").unlink(missing_ok=True)
    own.write_text(own.read_text() + "# changed\n")
    outcome = run_parcel(parcel)
    assert isinstance(outcome, PluginError)
    assert "its content is not what the command that started this process has approved" in str(outcome)
    assert not (tmp_path / "trace").exists()


@pytest.mark.gate
@pytest.mark.slow
def test_a_sweep_hands_its_decision_on(palpate, point_pipeline, tmp_path):
    canary(tmp_path)
    point_pipeline.write_text(with_plugin(point_pipeline) + '[sweep]\n"run.seed" = [1, 2]\n')
    done = palpate("sweep", point_pipeline, "--jobs", "2", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("executing plugin file") == 1
    for run in ("00001", "00002"):
        assert (tmp_path / "out" / run / "result.json").exists()


def test_a_command_names_a_pipeline_only_by_its_arguments(palpate, point_pipeline, tmp_path, monkeypatch):
    """So that a command that loads the pipeline of a folder, as any plugin's may, executes nothing of it."""
    file = tmp_path / "folder" / "pipeline.toml"
    file.parent.mkdir()
    own = canary(file.parent)
    file.write_text(with_plugin(point_pipeline))
    with trust.at_the_command_line([str(file.parent), "--pipeline=other.toml"]):
        with pytest.raises(PluginError, match="palpate trust"):
            load_pipeline(file)
        assert trust.is_named(Path("other.toml"))
    assert not (file.parent / "trace").exists()
    monkeypatch.chdir(file.parent)
    for arguments in ([str(file)], ["pipeline.toml"], [f"--pipeline={file}"]):
        with trust.at_the_command_line(arguments):
            load_pipeline(file)
    assert own.exists()


@pytest.mark.parametrize(("mode", "counts"), [(0o600, True), (0o644, True), (0o622, False), (0o660, False)])
def test_a_record_that_others_can_write_counts_for_nothing(tmp_path, mode, counts):
    own = canary(tmp_path)
    trust.trust_plugin(own)
    record = tmp_path / "state" / "palpate" / "trusted-plugins"
    assert record.stat().st_mode & 0o777 == 0o600
    record.chmod(mode)
    assert bool(trust.trusted_plugins()) == counts
    trust.trust_plugin(own)
    assert list(trust.trusted_plugins()) == [trust.PluginFile.read(own).digest]


def test_trust_takes_python_files(palpate, tmp_path):
    (tmp_path / "a.txt").write_text("")
    for name, message in (("none.py", "does not exist"), ("a.txt", "is not a Python file (.py)")):
        done = palpate("trust", name)
        assert (done.returncode, done.stdout) == (2, "")
        assert message in done.stderr
    (tmp_path / "state").write_text("")
    own = canary(tmp_path)
    done = palpate("trust", own)
    assert done.returncode == 2
    assert f"{tmp_path}/state/palpate/trusted-plugins: cannot write" in done.stderr
    assert os.path.exists(own)


@pytest.mark.parametrize("wording", ["import helper", "from helper import tip", "from .helper import tip"])
@pytest.mark.parametrize("place", ["helper.py", "helper/__init__.py"])
def test_what_an_approved_file_imports_from_beside_itself_is_not_executed(
    point_pipeline, tmp_path, monkeypatch, wording, place
):
    """Also where Python itself would look in the current folder, as ``python -c`` and a notebook do."""
    beside = tmp_path / place
    beside.parent.mkdir(exist_ok=True)
    canary(tmp_path).rename(beside)
    own = tmp_path / "lab.py"
    own.write_text(f"{wording}\n")
    trust.trust_plugin(own)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    with pytest.raises(PluginError, match=r"approval covers lab.py alone: move the code into it, or install both"):
        load_pipeline(point_pipeline, ['run.plugins=["lab.py"]'])
    assert not (tmp_path / "trace").exists()
    assert sys.path[0] == ""


def test_an_import_of_what_is_nowhere_is_told_as_it_is(point_pipeline, tmp_path):
    (tmp_path / "lab.py").write_text("import no_such_library\n")
    with pytest.raises(PluginError, match=r"No module named 'no_such_library' \(lab.py, line 1\)$"):
        load_pipeline(point_pipeline, ['run.plugins=["lab.py"]'])


def test_what_a_folder_sets_counts_as_said_by_nobody(point_pipeline, tmp_path):
    """Only a word of the command line does: a setting that a command reads from own.toml is none."""
    canary(tmp_path)
    text, setting = point_pipeline.read_text(), 'run.plugins=["canary.py"]'
    for words, said in (["fit", str(tmp_path)], False), (["run", "--set", setting], True), ([f"--set={setting}"], True):
        with trust.at_the_command_line(words):
            source = Source(text, point_pipeline)
            source.override(setting)
            assert source.has_chosen_plugins == said
    with trust.at_the_command_line([str(point_pipeline)]):
        source = Source.read(point_pipeline)
        assert source.has_chosen_plugins
        source.override(setting)
        assert not source.has_chosen_plugins


def test_a_link_to_a_file_that_is_named_is_another_file(point_pipeline, tmp_path, monkeypatch):
    """It says of what lies beside the link, not beside the file."""
    folder = tmp_path / "stranger"
    folder.mkdir()
    (folder / "pipeline.toml").symlink_to(point_pipeline)
    with trust.at_the_command_line([str(point_pipeline), str(folder)]):
        assert trust.is_named(point_pipeline)
        assert not trust.is_named(folder / "pipeline.toml")
    with trust.at_the_command_line([str(folder / "pipeline.toml")]):
        assert trust.is_named(folder / "pipeline.toml")
        assert trust.is_named(point_pipeline)


@pytest.mark.parametrize("words", [["--plugin=evil.py"], ["--plugin", "evil.py"]])
def test_a_file_that_a_pattern_of_the_shell_finds_is_no_option(palpate, tmp_path, words):
    """`palpate fit *` in a stranger's folder."""
    canary(tmp_path, "evil.py")
    (tmp_path / words[0]).write_text("")
    done = palpate("fit", *words, "--tip", "paraboloid 3 mm")
    assert done.returncode == 2
    assert f"write ./{words[0]} to name it" in done.stderr
    assert not (tmp_path / "trace").exists()


def test_a_partial_file_is_not_written_through_a_link(tmp_path):
    outside = tmp_path / "outside"
    outside.write_text("the user's\n")
    (tmp_path / f".review.json.{os.getpid()}.part").symlink_to(outside)
    with pytest.raises(OutputError, match=r"review\.json: cannot write"):
        write_whole(tmp_path / "review.json", "{}")
    assert outside.read_text() == "the user's\n"

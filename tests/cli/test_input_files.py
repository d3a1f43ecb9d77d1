"""Files that a pipeline takes data from: what is no plain file is refused, and a log names files of its folder only."""

import os
import re
import shutil
from typing import get_args

import pytest
from palpate.errors import ConfigurationError
from palpate.input_file import LARGEST, Enclosure, check_input
from palpate.parts import InputFile, Part, Settings, input_files
from palpate.registry import load
from palpate_engine.config import load_pipeline

TIP = '[indenter.tip]\ntype = "profile"\npoints = "{}"\n'
SHORT = ("--set", "trajectory.press.duration=1 s", "--set", 'run.tracks=["dr/ekf"]')


@pytest.fixture
def odd(tmp_path):
    """Files that must not be read."""
    os.mkfifo(tmp_path / "pipe")
    with (tmp_path / "giant").open("wb") as file:
        file.truncate(LARGEST + 1)
    return {"/dev/zero": "is not a regular file", "pipe": "is not a regular file", "giant": "at most 33554432 are read"}


def paths_of(settings, above):
    """Keys that hold a path, of settings and of those in them: with whether it is a file of data."""
    for name, field in settings.model_fields.items():
        if "Path" in str(field.annotation):
            yield f"{above}.{name}", "InputFile" in settings.__annotations__.get(name, "")
        for inner in nested(field.annotation):
            yield from paths_of(inner, f"{above}.{name}")


def nested(annotation):
    if isinstance(annotation, type) and issubclass(annotation, Settings) and not issubclass(annotation, Part):
        return [annotation]
    return [found for inner in get_args(annotation) for found in nested(inner)]


def test_every_path_is_a_file_of_data_or_known_as_something_else():
    found = {
        path: data
        for kind, entries in load().parts.items()
        for name, entry in entries.items()
        if entry.plugin.own
        for path, data in paths_of(entry.part, f"{kind}.{name}")
    }
    logs = {f"device.{name}-replay.file" for name in ("mcap", "csv", "rosbag2", "afm")}
    assert {path for path, data in found.items() if not data} == logs | {"twin.ur3e-bota.port"}
    assert {path.rpartition(".")[2] for path, data in found.items() if data} == {
        "points",
        "table",
        "file",
        "registration",
        "touches",
    }


@pytest.mark.parametrize("key", ["run.calibration", "indenter.tip.points"])
def test_what_is_no_plain_file_is_refused_in_words(point_pipeline, tmp_path, odd, key):
    tip = ["indenter.tip.type=profile"] if "tip" in key else []
    for name, words in odd.items():
        with pytest.raises(ConfigurationError, match=words) as refusal:
            load_pipeline(point_pipeline, [*tip, f"{key}={name}"])
        table, _, last = key.rpartition(".")
        assert f"[{table}] {last}: " in str(refusal.value)


@pytest.mark.parametrize("name", ["/dev/zero", "pipe", "giant"])
def test_the_pipeline_itself_is_a_plain_file(palpate, tmp_path, odd, name):
    done = palpate("check", name)
    assert done.returncode == 2
    assert odd[name] in done.stderr
    assert "Traceback" not in done.stderr


PROFILE = "".join(f"{r / 10},{(r / 10) ** 2 / 20}\n" for r in range(60))


@pytest.fixture
def recorded(palpate, point_pipeline, tmp_path):
    """A run with a tip from a table that lies beside the pipeline, and so not in the run folder."""
    (tmp_path / "tip.csv").write_text(PROFILE)
    text = re.sub(r"\[indenter\.tip\]\n(?:(?!\[).*\n)*", TIP.format("tip.csv"), point_pipeline.read_text())
    assert "tip.csv" in text
    point_pipeline.write_text(text)
    done = palpate("run", point_pipeline, *SHORT, "--out", "out")
    assert done.returncode == 0, done.stderr
    return tmp_path / "out"


@pytest.mark.slow
def test_a_log_names_files_of_the_recording_or_of_its_folder(palpate, recorded, tmp_path):
    (log,) = recorded.glob("*.mcap")
    assert palpate("replay", log, "--out", "again").returncode == 0  # elsewhere, but what it was recorded with
    (tmp_path / "tip.csv").write_text(PROFILE.replace("0.0,0.0", "0.0,0.0 "))
    done = palpate("replay", log, "--out", "other")
    assert done.returncode == 2
    assert f"{log.name}:" in done.stderr
    assert f"[indenter.tip] points: {tmp_path}/tip.csv: is outside the folder of {log.name}" in done.stderr
    shutil.copy(log, tmp_path / "moved.mcap")
    assert palpate("replay", tmp_path / "moved.mcap", "--out", "third").returncode == 0  # now it is in the log's folder


def test_an_enclosure_follows_links_and_hashes_plain_files_only(tmp_path):
    (tmp_path / "logs").mkdir()
    (tmp_path / "secret").write_text("1,2\n")
    (tmp_path / "logs" / "link").symlink_to(tmp_path / "secret")
    (tmp_path / "logs" / "table").write_text("1,2\n")
    enclosure = Enclosure(tmp_path / "logs" / "a.mcap")
    check_input(tmp_path / "logs" / "table", enclosure)
    for path in (tmp_path / "secret", tmp_path / "logs" / "link", tmp_path / "logs" / ".." / "secret"):
        with pytest.raises(ValueError, match=r"outside the folder of a\.mcap"):
            check_input(path, enclosure)
        check_input(path)
    with pytest.raises(ValueError, match="no file can have this name"):
        check_input(tmp_path / "a\0b")
    assert not enclosure.admits(tmp_path / "nothing")


def test_input_files_of_settings_are_found_where_they_are_nested(point_pipeline, tmp_path):
    class Inner(Part):
        kind = "test-inner"
        table: InputFile | None = None
        log: InputFile

    inner = Inner(table=tmp_path / "a", log=tmp_path / "b")
    assert input_files((inner, {"x": inner, "y": 1})) == [tmp_path / "a", tmp_path / "b"] * 2

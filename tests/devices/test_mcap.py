"""MCAP logs: what is recorded comes back to the last bit, here and in other readers."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from palpate import LogError
from palpate_devices.mcap_replay import McapReplay
from palpate_devices.messages import WRENCH, message_type, numbers_type, pack
from palpate_engine.config import load_pipeline
from palpate_engine.pipeline import run_pipeline
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.readings import FieldReading
from palpate_records.messages.topics import Messages, Topic
from palpate_testing import check_device

SHORT = ("trajectory.press.duration=1 s", "trajectory.press.speed=20 mm/s")


@pytest.fixture
def recording(run_point):
    """The log of a short run."""
    return run_point(*SHORT, name="recording").folder / "log.mcap"


def replay_of(log, pipeline, **device):
    """The pipeline with the log in the place of the rig."""
    table = {"type": "mcap-replay", "file": str(log), **device}
    text = ", ".join(f"{key} = {json.dumps(value)}" for key, value in table.items())
    return load_pipeline(pipeline, [f"device.rig={{{text}}}", 'run.tracks=["*/ekf"]'])


def test_offline_estimates_are_at_the_times_of_their_samples(run_point):
    """They come at the end, with times from its beginning, which are no stamps."""
    from mcap.reader import make_reader

    only = ('estimator.smoother.type="kinematic-smoother"', 'run.tracks=["*/smoother"]')
    with (run_point(*SHORT, *only, name="offline").folder / "log.mcap").open("rb") as file:
        times = {channel.topic: [] for channel in make_reader(file).get_summary().channels.values()}
        for _, channel, message in make_reader(file).iter_messages():
            times[channel.topic].append(message.log_time)
    assert times["/palpate/estimates/dr/smoother"] == times["/palpate/samples"]


def test_a_replay_gives_the_same_estimates_bit_for_bit(recording, point_pipeline, tmp_path):
    run_pipeline(replay_of(recording, point_pipeline), tmp_path / "replay")
    assert (tmp_path / "replay" / "estimates.csv").read_bytes() == (recording.parent / "estimates.csv").read_bytes()
    folders = (recording.parent, tmp_path / "replay")
    live, again = (json.loads((folder / "result.json").read_text()) for folder in folders)
    for result in (live, again):
        del result["tracks"]["dr/ekf"]["seconds_per_sample"]
    assert live["tracks"] == again["tracks"]
    assert live["streams"] == again["streams"]


def test_a_replay_of_a_replay_is_the_same_again(recording, point_pipeline, tmp_path):
    first = run_pipeline(replay_of(recording, point_pipeline), tmp_path / "one").folder
    second = run_pipeline(replay_of(first / "log.mcap", point_pipeline), tmp_path / "two").folder
    assert (first / "estimates.csv").read_bytes() == (second / "estimates.csv").read_bytes()


def test_other_tracks_on_a_recording(recording, point_pipeline, tmp_path):
    pipeline = load_pipeline(
        point_pipeline,
        [
            f'device.rig={{type = "mcap-replay", file = "{recording}"}}',
            'estimator.soft={type = "ekf", first_guess = {elasticity = "50 kPa"}}',
            "estimator.soft.force_std=0.1",
        ],
    )
    result = run_pipeline(pipeline, tmp_path / "replay")
    assert set(result.tracks) == {"dr/ekf", "dr/kinematic", "dr/soft"}


def test_it_keeps_the_promises_of_a_device(recording):
    check_device(McapReplay(file=recording))


def test_the_recording_holds_what_it_takes_to_redo_the_run(recording):
    from mcap.reader import make_reader

    with recording.open("rb") as file:
        reader = make_reader(file)
        attachments = {a.name: a.data.decode() for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        topics = {c.topic for c in reader.get_summary().channels.values()}
    for name in ("pipeline.toml", "given.toml"):
        assert attachments[name] == (recording.parent / name).read_text()
    assert {"palpate", "numpy", "casadi", "seed"} <= set(metadata["palpate"])
    assert {"/rig/wrench", "/rig/tip", "/rig/twist", "/palpate/samples", "/palpate/estimates/dr/ekf"} <= topics


def test_another_reader_sees_the_same_messages(recording):
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with McapReplay(file=recording).connect(0) as link:
        batches = [batch for batch in link.batches() if batch.stream == "wrench"]
    ours = np.concatenate([batch.values for batch in batches])
    stamps = np.concatenate([batch.time for batch in batches])
    with recording.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        messages = [decoded for *_, decoded in reader.iter_decoded_messages(topics=["/rig/wrench"])]
    assert len(messages) == len(ours)
    theirs = [[m.wrench.force.x, m.wrench.force.y, m.wrench.force.z] for m in messages]
    np.testing.assert_array_equal(np.array(theirs), ours[:, :3])
    assert [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in messages] == stamps.tolist()
    assert messages[0].header.frame_id == "tip"


def unpack(messages, count):
    """Stamps and numbers of messages of a header and so many numbers."""
    names = [f"n{i}" for i in range(count)]
    kind = numbers_type("Load", names)
    decoder = decoder_of(Topic("/load", kind.name, schema=kind.definition.encode()))
    none = np.zeros(len(messages), np.int64)
    table = decoder.read(Messages.joined(messages, none, none), [FieldReading(name) for name in names])
    return table.stamps, table.values


@pytest.mark.parametrize("frame", ["", "a", "work", "ft_sensor0_wrench", "é"])
@pytest.mark.parametrize("count", [1, 6, 7])
def test_messages_survive_packing(frame, count):
    random = np.random.default_rng(0)
    stamps = np.array([0, 1, 999_999_999, 10**9, 1_700_000_000_123_456_789], np.int64)
    numbers = random.standard_normal((5, count))
    numbers[2, 0] = np.nan
    back, values = unpack(pack(stamps, frame, numbers), count)
    np.testing.assert_array_equal(back, stamps)
    np.testing.assert_array_equal(values, numbers)


def test_messages_of_different_frames_in_one_block():
    numbers = np.arange(6.0)[None]
    mixed = pack(np.array([5], np.int64), "a", numbers) + pack(np.array([7], np.int64), "longer frame", numbers)
    stamps, values = unpack(mixed, 6)
    assert stamps.tolist() == [5, 7]
    assert values.shape == (2, 6)


@pytest.mark.parametrize("damage", [b"", b"\0" * 20, b"\x00\x01\x00\x00" + b"\xff" * 60])
def test_a_message_that_is_none_is_refused(damage):
    with pytest.raises(LogError, match="message"):
        unpack([damage], 6)


def test_types_are_known_with_and_without_msg():
    assert message_type("geometry_msgs/WrenchStamped", "") is WRENCH
    assert message_type("geometry_msgs/msg/WrenchStamped", "") is WRENCH
    own = numbers_type("Load", ["a", "b"])
    assert message_type(own.name, own.definition).fields == ("a", "b")
    assert message_type("std_msgs/msg/String", "string data") is None


def test_a_cut_log_is_refused_with_what_is_whole_and_opens_on_request(recording, point_pipeline, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recording.read_bytes()[: recording.stat().st_size * 2 // 3])
    with pytest.raises(LogError, match=r"the log is cut: .* [0-9]+ messages over .* accept_cut = true"):
        _ = McapReplay(file=cut).streams
    result = run_pipeline(replay_of(cut, point_pipeline, accept_cut=True), tmp_path / "replay")
    assert any("cut" in flag.message for flag in result.flags)
    assert result.streams["rig.wrench"]["samples"] > 500


@pytest.mark.parametrize("size", [0, 4, 8, 9, 60, 500])
def test_logs_cut_near_the_beginning(recording, tmp_path, size):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recording.read_bytes()[:size])
    with pytest.raises(LogError, match=r"empty|not an MCAP log|is cut"):
        _ = McapReplay(file=cut).streams


@pytest.mark.parametrize("seed", range(12))
def test_a_flipped_bit_is_never_read_as_data(recording, tmp_path, seed):
    """Either it is refused, or it sits where no reading is, and every reading is what it was."""

    def read(path):
        with McapReplay(file=path).connect(0) as link:
            batches = list(link.batches())
        return {(b.stream, int(b.time[0])): b.values for b in batches}

    raw = bytearray(recording.read_bytes())
    position = int(np.random.default_rng(seed).integers(8, len(raw) - 8))
    raw[position] ^= 1 << (seed % 8)
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(raw)
    try:
        found = read(damaged)
    except LogError:
        return
    true = read(recording)
    assert found.keys() == true.keys()
    for key, values in true.items():
        np.testing.assert_array_equal(found[key], values)


def test_a_file_that_is_no_log(tmp_path):
    other = tmp_path / "other.mcap"
    other.write_text("this is a text, not a log, and it is longer than a header")
    with pytest.raises(LogError, match="is not an MCAP log"):
        _ = McapReplay(file=other).streams
    with pytest.raises(LogError, match="no such file"):
        _ = McapReplay(file=tmp_path / "none.mcap").streams


@pytest.mark.slow
def test_topics_can_be_named(recording):
    named = McapReplay(file=recording, topics={"force": "/rig/wrench"})
    assert [stream.name for stream in named.streams] == ["force"]
    with pytest.raises(LogError, match="is not in the log"):
        _ = McapReplay(file=recording, topics={"force": "/rig/wrong"}).streams


def test_real_logs_of_others_are_read_or_refused_in_words(shared):
    for path in sorted((shared / "mcap").glob("*.mcap")):
        try:
            streams = McapReplay(file=path).streams
        except LogError as refusal:
            words = str(refusal)
        else:
            words = path.name
            with McapReplay(file=path).connect(0) as link:
                assert {batch.stream for batch in link.batches()} <= {stream.name for stream in streams}
        assert path.name in words


@pytest.mark.slow
def test_the_readers_of_npm_find_the_same(recording):
    """NODE_PATH must lead to @mcap/core, @foxglove/rosmsg, @foxglove/rosmsg2-serialization and fzstd."""
    node = shutil.which("node")
    packages = ("@mcap/core", "@foxglove/rosmsg", "@foxglove/rosmsg2-serialization", "fzstd")
    lookup = "".join(f"require.resolve('{name}');" for name in packages)
    if node is None or subprocess.run([node, "-e", lookup], capture_output=True).returncode:
        pytest.skip(f"the readers of npm are not here: node, and {', '.join(packages)} on NODE_PATH")
    script = Path(__file__).parent / "read_mcap.cjs"
    done = subprocess.run([node, script, recording], capture_output=True, text=True, timeout=60, check=True)
    found = json.loads(done.stdout)
    ours = {}
    for topic, names, batch in McapReplay.tables(recording):
        columns = [k for k, name in enumerate(names) if not name.startswith("header.")]
        count, total = ours.get(topic, (0, 0.0))
        values = batch.values[:, columns]
        ours[topic] = count + len(values), total + float(values.sum())
    assert found.keys() == ours.keys()
    for topic, (count, total) in ours.items():
        assert found[topic][0] == count
        if np.isfinite(total):
            assert found[topic][1] == pytest.approx(total, rel=1e-9, abs=1e-9)


def test_a_log_of_a_newer_palpate_is_refused_by_name(monkeypatch, run_point, tmp_path):
    from palpate_devices import log_recorder

    monkeypatch.setattr(log_recorder, "LOG_SCHEMA", 7)
    folder = run_point("trajectory.press.duration=1 s").folder
    with pytest.raises(LogError, match=r"newer palpate, with schema 7; this one reads up to 1"):
        McapReplay(file=folder / "log.mcap").streams  # noqa: B018

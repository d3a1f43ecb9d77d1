"""What is suggested for a running system keeps a robot's threshold: the noise of the record is for files."""

from pathlib import Path

from palpate_kit.logs.topic_suggestion import suggestion_for
from palpate_logs.rosbag2_replay import Rosbag2Replay, _open_bag
from palpate_ros2 import domain_survey

from tests.records.bags import press, transforms_message, wrench_message, write_bag


def test_touch_of_a_live_run_is_not_by_the_noise_of_the_record(tmp_path, monkeypatch):
    wrench, moved = [], []
    for t, z, _, f in zip(*press(), strict=True):
        stamp = 1_700_000_000 * 10**9 + round(t * 1e9)
        wrench.append((stamp, wrench_message(stamp, "ft", (0, 0, f, 0, 0, 0))))
        moved.append((stamp, transforms_message([(stamp, "base", "tool0", (0.4, 0.0, z, 0, 0, 0, 1))])))
    topics = [("/wrench", "geometry_msgs/msg/WrenchStamped", wrench), ("/tf", "tf2_msgs/msg/TFMessage", moved)]
    file = write_bag(tmp_path / "live.db3", topics)
    assert Rosbag2Replay.suggest(file, {}).alignment["touch_force"] == "noise"
    container = _open_bag(file)
    assert suggestion_for(container, Path("x"), "ros2", {}).alignment["touch_force"] == "noise"
    monkeypatch.setattr(domain_survey, "snapshot_at", lambda address: container)
    live = domain_survey.address_of("ros2://0").suggest({})
    assert "touch_force" not in live.alignment
    assert live.alignment["force"]

"""Runs of the shipped pipelines, replays of their logs, fits of these, and a filter as C."""

from pathlib import Path

from same_scenes.command import ROOT, palpate

_SIMULATED = ('type = "sim"', "base = [")  # by itself, or by the rig of another file


def _shipped() -> list[Path]:
    """Return the shipped pipelines that run by themselves; a rig without an estimator is a part of others."""
    texts = {path: path.read_text() for path in sorted(ROOT.glob("pipelines/**/*.toml"))}
    return [path for path, text in texts.items() if "[estimator." in text and any(sign in text for sign in _SIMULATED)]


SHIPPED = _shipped()


def run_pipelines(folder: Path) -> None:
    """Make every run, replay, fit and export, each in a folder of its own."""
    folder = folder.resolve()
    for path in SHIPPED:
        name = "-".join(path.relative_to(ROOT / "pipelines").with_suffix("").parts)
        palpate("run", path, "--out", folder / name)
    point = folder / "point"
    palpate("rehearse", "pipelines/point_ur3e.toml", "--hold-up", "robot 8 ms every 1 s", "--out", folder / "rehearsal")
    for run in ("point", "raster", "rehearsal"):
        palpate("replay", folder / run, "--add-estimator", "afukf", "--out", folder / f"replay_{run}")
    logs = folder / "logs"
    logs.mkdir()
    palpate("log", "export", point / "log.mcap", "--out", logs / "point.csv")
    palpate("run", "pipelines/filters.toml", "--set", "run.seed=2", "--out", folder / "second")
    palpate("log", "export", folder / "second" / "log.mcap", "--out", logs / "second.csv")
    signals = ("--force", "/rig/wrench:wrench.force.z", "--position", "/rig/tip:pose.position.z")
    pipeline = folder / "csv.toml"
    palpate("info", logs / "point.csv", *signals, "--velocity", "/rig/twist:twist.linear.z", "--out", pipeline)
    palpate("run", pipeline, "--out", folder / "replay_csv")
    palpate("fit", "--each", logs, "--pipeline", pipeline, "--out", folder / "each")
    palpate("fit", point, "--out", folder / "fit")
    palpate("fit", "indentation", point, "--out", folder / "indentation")
    palpate("model", "export", point, "--track", "dr/kinematic", "--out", folder / "controller")

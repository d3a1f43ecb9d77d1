"""What is shown of real logs: every finding of every track on the public recordings of the paper's authors.

Run: python benchmarks/real_logs.py [FOLDER WITH ur3e-bota-2024 AND rosbag2]. Points with delays declared to 0.5 ms, and
with none declared (the mean delay is declared all the same); the foam and the load-unload bag as far as the loading.
"""

from __future__ import annotations

import gzip
import os
import shutil
import statistics
import sys
import tempfile
from pathlib import Path

from palpate_engine import Result
from palpate_engine.config import Source, build_pipeline
from palpate_engine.pipeline import run_pipeline

POINTS = {  # file: radius, lateness of motion and of force
    "d10mm_soft": ("5 mm", "22 ms", "0 ms"),
    "d10mm_sphere": ("5 mm", "22 ms", "0 ms"),
    "d5mm_soft": ("2.5 mm", "0 ms", "12 ms"),
}
ESTIMATORS = """
[estimator.ekf]
type = "ekf"
[estimator.afukf]
type = "afukf"
[estimator.kinematic]
type = "kinematic-ekf"
[estimator.smoother]
type = "kinematic-smoother"
[estimator.fit]
type = "casadi-fit"
"""
POINT = """
[device.log]
type = "csv-replay"
file = "{file}"
rate = "500 Hz"
columns.z = {{ column = 0, unit = "mm" }}
columns.v = {{ column = 3, unit = "mm/s" }}
columns.fz = {{ column = 4, unit = "N" }}
[alignment]
force = {{ channel = "log.fz", delay = "{force}" }}
position = {{ channel = "log.z", delay = "{motion}"{timing} }}
velocity = {{ channel = "log.v", sign = -1, delay = "{motion}"{timing} }}
tare = "0 N"
tare_uncertainty = "0 N"
tip_mass = "140 g"
[indenter.tip]
type = "sphere"
radius = "{radius}"
[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
[model.layer]
type = "dimensionality-reduction"
indenter = "tip"
thickness = {{ law = "dimitriadis", height = "22 mm", bonded = false }}
"""
BAG = """
[device.log]
type = "rosbag2-replay"
file = "{file}"
time = {{ field = "data", index = 0, unit = "s" }}
[device.log.signals]
position = {{ topic = "/data_control", field = "data", index = {z}, unit = "m" }}
velocity = {{ topic = "/data_control", field = "data", index = {v}, unit = "m/s" }}
force = {{ topic = "/data_control", field = "data", index = {f}, unit = "N" }}
[alignment]
force = {{ channel = "log.data_control.force", sign = {sign} }}
position = {{ channel = "log.data_control.position" }}
velocity = {{ channel = "log.data_control.velocity" }}
tip_mass = "140 g"
tare = "none"
[indenter.tip]
type = "sphere"
radius = "10 mm"
[model.hc]
type = "hunt-crossley"
indenter = "tip"
"""


def runs(folder: Path, scratch: Path) -> dict[str, str]:
    """Pipelines by name."""
    texts = {}
    for name, (radius, motion, force) in POINTS.items():
        file = folder / "ur3e-bota-2024" / f"{name}.csv.gz"
        for declared, timing in (("timing declared", ', uncertainty = "0.5 ms"'), ("timing not declared", "")):
            point = POINT.format(file=file, radius=radius, motion=motion, force=force, timing=timing)
            texts[f"{name}, {declared}"] = point + ESTIMATORS
    for name, columns in (("ur3e_load_unload_soft_1", (3, 4, 5, -1)), ("foam_white_1_p", (2, 4, 5, -1))):
        bag = scratch / f"{name}.db3"
        with gzip.open(folder / "rosbag2" / f"{name}.db3.gz") as packed, bag.open("wb") as whole:
            shutil.copyfileobj(packed, whole)
        z, v, f, sign = columns
        texts[name] = BAG.format(file=bag, z=z, v=v, f=f, sign=sign) + ESTIMATORS
    return texts


def shown(result: Result) -> dict[str, list[str]]:
    """Findings by track: severity, code and message, those of the record among them."""
    return {
        name: [
            f"{flag.severity}: {flag}"
            for flag in (*result.flags, *track.flags)
            if flag.severity in ("doubtful", "invalid")
        ]
        for name, track in result.tracks.items()
    }


def main() -> None:
    """Print values, verdicts and findings of all logs, and how many findings a track has."""
    default = Path(os.environ.get("PALPATE_SHARED", "../shared")) / "data"
    folder = (Path(sys.argv[1]) if len(sys.argv) > 1 else default).resolve()
    counts = []
    with tempfile.TemporaryDirectory() as scratch:
        for name, text in runs(folder, Path(scratch)).items():
            print(f"\n{name}")
            pipeline = build_pipeline(Source(text, Path(scratch) / "pipeline.toml"))
            result = run_pipeline(pipeline, Path(scratch) / name.replace(" ", "_").replace(",", ""))
            findings = shown(result)
            for track, flags in findings.items():
                values = result.tracks[track].parameters
                numbers = ", ".join(
                    f"{key} {v.value:.5g} ± {v.combined:.2g} ({v.verdict})" for key, v in values.items()
                )
                print(f"  {track}: {result.tracks[track].verdict}: {numbers}")
                for flag in flags:
                    print(f"      {flag}")
                for flag in result.tracks[track].immaterial:
                    print(f"      (immaterial) {flag}")
                counts.append(len(flags))
    print(f"\nfindings of {len(counts)} tracks: median {statistics.median(counts):g}, most {max(counts)}")


if __name__ == "__main__":
    main()

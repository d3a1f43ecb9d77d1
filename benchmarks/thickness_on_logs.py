"""Elasticity of the paper's soft silicone from two tips, by the paper's model and by one that knows its geometry.

Run: python benchmarks/thickness_on_logs.py [FOLDER WITH ur3e-bota-2024]. The logs are the authors' own; the delays are
those that their tables need. The same as `palpate run` on the pipeline below, once for each log, in one table.
"""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from palpate_engine import TrackName
from palpate_engine.config import Source, build_pipeline
from palpate_engine.pipeline import run_pipeline

TRUTH = 112.5  # kPa, compression test
HEIGHT = "22 mm"
LOGS = (  # file, radius, lateness of motion and of force, published kPa
    ("d5mm_soft", "2.5 mm", "0 ms", "12 ms", 109.7),
    ("d10mm_soft", "5 mm", "22 ms", "0 ms", 129.5),
)
PIPELINE = """
[device.log]
type = "csv-replay"
file = "{file}"
rate = "500 Hz"
columns.z = {{ column = 0, unit = "mm" }}
columns.rate = {{ column = 3, unit = "mm/s" }}
columns.force = {{ column = 4, unit = "N" }}

[alignment]
force = {{ channel = "log.force", delay = "{force}" }}
position = {{ channel = "log.z", delay = "{motion}" }}
velocity = {{ channel = "log.rate", delay = "{motion}", sign = -1 }}
tip_mass = "140 g"
tare = "0 N"
tare_uncertainty = "0 N"

[indenter.paraboloid]
type = "sphere"
radius = "{radius}"

[indenter.sphere]
type = "exact-sphere"
radius = "{radius}"

[model.paper]
type = "dimensionality-reduction"
indenter = "paraboloid"

[model.exact]
type = "dimensionality-reduction"
indenter = "sphere"

[model.exact-thin]
type = "dimensionality-reduction"
indenter = "sphere"
thickness = {{ law = "dimitriadis", height = "{height}", bonded = false }}

[model.cylinder]
type = "dimensionality-reduction"
indenter = "paraboloid"
thickness = {{ law = "finite-cylinder", height = "{height}", diameter = "50 mm", bonded = false }}

[estimator.ekf]
type = "ekf"
"""


def elasticities(folder: Path, name: str, radius: str, motion: str, force: str) -> dict[str, tuple[float, float]]:
    """Elasticity and its std [kPa] by model name."""
    file = folder / "ur3e-bota-2024" / f"{name}.csv.gz"
    text = PIPELINE.format(file=file, radius=radius, motion=motion, force=force, height=HEIGHT)
    with tempfile.TemporaryDirectory() as out:
        result = run_pipeline(build_pipeline(Source(text, Path("pipeline.toml"))), Path(out) / "run")
    found = {label: track.parameters["elasticity"] for label, track in result.tracks.items()}
    return {TrackName.parse(label).model: (e.value / 1e3, e.std / 1e3) for label, e in found.items()}


def main() -> None:
    """Print the table."""
    shared = Path(os.environ.get("PALPATE_SHARED", Path(__file__).parents[2] / "shared"))
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else shared / "data"
    print(f"{'log':<12}{'R':>8}{'published':>11}  model         E [kPa]   from {TRUTH} kPa")
    for name, radius, motion, force, published in LOGS:
        for model, (value, _) in elasticities(folder, name, radius, motion, force).items():
            print(f"{name:<12}{radius:>8}{published:>11}  {model:<12}{value:9.1f}{100 * (value / TRUTH - 1):+11.1f} %")


if __name__ == "__main__":
    main()

"""What a sweep of one filter's settings over one log costs, and what its recursion has of that.

Run it with: python benchmarks/sweep_of_settings.py [SETTINGS] [SECONDS]          (256 settings, a palpation of 10 s)
A palpation is recorded by the simulated rig, then swept over `force_std` of the paper's filter: by `palpate sweep` on
all cores, by the clock; and a few of its runs in this process, with the processor's time inside the kernel. What eight
settings in the lanes of the processor could save at most is 7/8 of that. filterpy's time is of the recursion alone,
without reading, alignment, uncertainty and tables: that of this many runs one after the other, by a few.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from filters_speed import MODEL, python_ekf
from palpate_kit.jobs.job import Job, PortablePipeline, run_or_find
from palpate_kit.kernel.llvm import CompiledStep
from palpate_testing import synthetic_samples

ROOT = Path(__file__).parent.parent
PALPATE = [sys.executable, "-c", "from palpate_engine.cli import main; main()"]
FEW = 8  # runs in this process


def log_of(folder: Path, seconds: float) -> str:
    """Record a palpation of so many seconds; the pipeline that replays it with one filter."""
    made = [*PALPATE, "run", ROOT / "pipelines/filters.toml", "--out", folder / "made"]
    made += ["--set", f"trajectory.press.duration={seconds:g} s"]
    subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
    text = (ROOT / "pipelines/filters.toml").read_text(encoding="utf-8")
    head, rest = text.split("[device.rig]")
    alignment = "[alignment]" + rest.split("[alignment]")[1].split("[estimator.ekf]")[0]
    device = f'[device.rig]\ntype = "mcap-replay"\nfile = "{folder / "made" / "log.mcap"}"\n\n'
    return f'{head}{device}{alignment}\n[estimator.ekf]\ntype = "ekf"\n'


def inside(text: str, folder: Path, values: list[float]) -> tuple[float, float, int]:
    """Processor time [s] of one run of a sweep, that of its kernel, and its samples."""
    spent, run = [], CompiledStep.run

    def timed(self: CompiledStep, *arguments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        before = time.thread_time()
        found = run(self, *arguments)
        spent.append(time.thread_time() - before)
        return found

    CompiledStep.run = timed
    jobs = [
        Job(
            str(i),
            PortablePipeline(text, folder / "log.toml", (f'estimator.ekf.force_std="{value} N"',)),
            folder / f"{i:05d}",
        )
        for i, value in enumerate(values, start=1)
    ]
    run_or_find(jobs[0])  # compiles
    spent.clear()
    before = time.process_time()
    found = [run_or_find(job).result for job in jobs[1:]]
    whole = time.process_time() - before
    CompiledStep.run = run
    return whole / len(found), sum(spent) / len(found), int(found[0].run["samples"])


def main() -> None:
    """Record, sweep, and print."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 256
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
    values = np.geomspace(0.02, 0.2, count).round(6).tolist()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        text = log_of(folder, seconds)
        sweep = folder / "sweep.toml"
        listed = ", ".join(f'"{value} N"' for value in values)
        sweep.write_text(f'{text}\n[sweep]\n"estimator.ekf.force_std" = [{listed}]\n', encoding="utf-8")
        one, kernel, samples = inside(text, folder / "few", values[: FEW + 1])
        before = time.monotonic()
        subprocess.run([*PALPATE, "sweep", sweep, "--out", folder / "out"], check=True, stdout=subprocess.DEVNULL)
        whole = time.monotonic() - before
    few = python_ekf(synthetic_samples(MODEL, [1.1e5, 360.0], duration=4.0), 2000)
    before = time.process_time()
    few()
    peer = (time.process_time() - before) / 2000 * samples
    print(f"a log of {samples} samples, {count} settings of one filter")
    print(f"palpate sweep: {whole:.1f} s by the clock, {1e3 * whole / count:.0f} ms a setting")
    print(f"one run in a warm process: {1e3 * one:.1f} ms of processor, {1e3 * kernel:.2f} ms of it in the kernel")
    print(f"lanes could save at most {100 * kernel * 7 / 8 / one:.2f} % of it")
    print(f"filterpy's recursion alone: {1e3 * peer:.0f} ms a setting; all take {peer * count / whole:.1f} sweeps")


if __name__ == "__main__":
    main()

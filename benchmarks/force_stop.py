"""From a reading over the force limit to the command that stops the arm, while the main process is stopped by a signal.

``python benchmarks/force_stop.py 20``: a specimen twenty times stiffer than expected; SIGSTOP for the main process when
the tip touches, SIGCONT a second later. "command": from the sensor's process having the reading to the servo process
having turned around; "peak": largest force on the skin, by the twin; "bound" is what the limits' latency would explain.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from faults import devices_conftest

_STIFF = ("twin.bench.specimen.elasticity=2.25 MPa", "twin.bench.specimen.viscosity=7240 Pa*s")
_QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


def measured(module, folder: Path) -> tuple[float, float, float] | None:
    """Latency [s], peak force and bound [N]; None where the machine ended the run before."""
    twin = module.Bench(folder, (*module.SHORT, *_STIFF))
    try:
        _, declared, _ = module.ForceLimit.cases["twenty times stiffer"]
        sets = (*module.SHORT, *module.PATIENT, *declared, "device.arm.host_timeout=5 s", 'run.tracks=["dr/ekf"]')
        job, out = twin.start_job(lambda state, _: state["peak_force"] > 0.2, sets, folder / "out", **_QUIET)
        job.send_signal(signal.SIGSTOP)
        time.sleep(1.0)
        state = twin.state()
        job.send_signal(signal.SIGCONT)
        job.wait(120)
    finally:
        twin.close()
    live = json.loads((out / "result.json").read_text())["run"]["live"]
    stop = live["devices"]["arm"].get("own_stop")
    if stop is None or "over the limit" not in stop["reason"]:
        return None
    batches = module.readings(out / "log.mcap", "sensor", "wrench")
    received = np.concatenate([batch.received for batch in batches]) / 1e9 - (time.time() - time.monotonic())
    force = np.concatenate([batch.values[:, 2] for batch in batches]) - live["standstill"]["force"]
    over = received[np.flatnonzero(np.abs(force) > module.ForceLimit.stop)[0]]
    return stop["monotonic"] - over, state["peak_force"], module.ForceLimit.bound(2.25e6, 0.0165)


def main() -> None:
    """So many times."""
    repeats, rows, module = int(sys.argv[1]) if len(sys.argv) > 1 else 10, [], devices_conftest()
    for _ in range(repeats):
        with tempfile.TemporaryDirectory() as name:
            row = measured(module, Path(name))
        if row is not None:
            rows.append(row)
            print(f"command {1e3 * row[0]:.2f} ms, peak {row[1]:.1f} N, bound {row[2]:.1f} N", flush=True)
    late, peak = sorted(1e3 * row[0] for row in rows), max(row[1] for row in rows)
    print(
        f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores, {len(rows)} of {repeats} runs: command after "
        f"{late[len(late) // 2]:.2f} ms (median), {late[-1]:.2f} ms (largest); peak at most {peak:.1f} N"
    )


if __name__ == "__main__":
    main()

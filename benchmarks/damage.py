"""How much of what is whole in a damaged log `palpate recover` brings back, counted by the plain `mcap` library.

    python benchmarks/damage.py [--count 25] [--seed 1]

Logs of 6000 messages, in five ways of writing, are damaged in eight ways; of each, the messages of all chunks of which
no byte was touched are counted in what was written, and looked for in what was recovered.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from palpate import UserError
from palpate_devices.mcap_replay import McapReplay

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.devices import damage


def main() -> None:
    """Print the table of kinds of damage and what came back."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=25, help="logs of each kind")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    logs = {style: damage.write(style) for style in damage.WRITERS}
    written = {style: list(damage.chunks(raw)) for style, raw in logs.items()}
    print(f"{'damage':15}{'logs':>6}{'whole':>10}{'back':>10}{'share %':>9}{'not true':>10}{'refused':>9}{'most s':>8}")
    totals, longest = np.zeros(4, int), 0.0
    with tempfile.TemporaryDirectory() as folder:
        for number, kind in enumerate(damage.KINDS):
            row, slowest = np.zeros(4, int), 0.0
            for i in range(options.count):
                rng = np.random.default_rng([options.seed, number, i])
                style = list(logs)[i % len(logs)]
                damaged = kind(logs[style], rng)
                began = time.perf_counter()
                row += _outcome(damaged, written[style], Path(folder), f"{kind.__name__}, {i}, {style}")
                slowest = max(slowest, time.perf_counter() - began)
            _print(kind.__name__, options.count, row, slowest)
            totals, longest = totals + row, max(longest, slowest)
    _print("all", options.count * len(damage.KINDS), totals, longest)


def _print(name: str, count: int, row: np.ndarray, slowest: float) -> None:
    share = 100.0 * row[1] / max(row[0], 1)
    print(f"{name:15}{count:6}{row[0]:10}{row[1]:10}{share:9.3f}{row[2]:10}{row[3]:9}{slowest:8.2f}")


def _outcome(damaged: damage.Damaged, written: list, folder: Path, name: str) -> np.ndarray:
    """Messages that are whole, that came back, that came back and were never written; refusals."""
    bad, good = folder / "bad.mcap", folder / "good.mcap"
    bad.write_bytes(damaged.raw)
    good.unlink(missing_ok=True)
    expected = damage.whole(damaged, written)
    everything = sum((messages for _, _, messages in written), start=type(expected)())
    try:
        said = McapReplay.recover(bad, good)
    except UserError as refusal:
        if expected:
            print(f"  {name}: {refusal}")
        return np.array([expected.total(), 0, 0, 1])
    found = damage.messages(good)
    back = (found & expected).total()
    if back < expected.total() or found - everything:
        print(f"  {name}: {back} of {expected.total()}: {said}")
    return np.array([expected.total(), back, (found - everything).total(), 0])


if __name__ == "__main__":
    main()

"""Files of a small study: presses in two dialects, a stack of curves, a sweep of an instrument, a shake in free air."""

import csv
from pathlib import Path

import numpy as np
from palpate import Floats

HEAD = "time_s,force_N,height_mm"
RIG = """instrument = "a press"
tip = "sphere 5 mm"
delay = "0 ms +- 0.2 ms"
tip_mass = "10 g +- 1 g"
tare = "none"
poisson = 0.5
"""
GROUPS = [f"{group}_{animal}{number}" for group in ("control", "treated") for animal in "ab" for number in "12"]
STATED: dict[str, dict[str, str]] = {
    "control_a1": {"thickness": "10 mm", "delay": "3 ms +- 0.1 ms"},
    "treated_a1": {"tip": "sphere 4 mm", "tare": "20 mN +- 1 mN"},
    "treated_b2": {"mount": "20 N/mm", "inclination": "8 deg"},
}


def press(seed: int, elasticity: float = 25e3, viscosity: float = 40.0, count: int = 200) -> Floats:
    """Return time [s], force [N] and height [mm] (n, 3) of a press by a sphere of 5 mm, with noise."""
    random = np.random.default_rng(seed)
    time = np.arange(count) / 200
    depth = 2.5e-3 * np.sin(np.pi * time / time[-1]) - 0.5e-3
    contact, speed = np.maximum(depth, 0.0), np.gradient(depth, time)
    force = 16 / 9 * elasticity * np.sqrt(5e-3) * contact**1.5 + 8 * viscosity * np.sqrt(5e-3 * contact) * speed
    force = force + 2e-3 * random.standard_normal(count)
    return np.column_stack([time, force, -1e3 * depth + 2e-4 * random.standard_normal(count)])


def write_table(path: Path, table: Floats, head: str = HEAD, delimiter: str = ",") -> None:
    """Write a table of numbers with a head."""
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, table, delimiter=delimiter, header=head, comments="", fmt="%.9g")


def write_curves(folder: Path) -> None:
    """Write curves in two dialects, with ``rig.toml``, ``curves.csv`` and a table of groups."""
    for seed, name in enumerate(GROUPS):
        treated = name.startswith("treated")
        table = press(seed, 25e3 * (1.0 + 0.3 * treated + 0.02 * (seed % 3)))
        if name.endswith("b2"):
            write_table(folder / "b" / f"{name}.csv", table * (1.0, 1e3, 1.0), "t [s];F [mN];z [mm]", ";")
        else:
            write_table(folder / f"{name}.csv", table)
    (folder / "rig.toml").write_text(RIG)
    lines = [f"study/{name}.csv,{name[-2:]}" for name in GROUPS if not name.endswith("b2")]
    (folder.parent / "groups.csv").write_text("\n".join(["curve,mouse", *lines]) + "\n")
    columns = [
        "curve",
        "treatment",
        "animal",
        "specimen",
        "x_m",
        "y_m",
        *dict.fromkeys(key for c in STATED.values() for key in c),
    ]
    with (folder / "curves.csv").open("w", newline="") as file:
        table_of_curves = csv.DictWriter(file, columns, restval="")
        table_of_curves.writeheader()
        for number, name in enumerate(GROUPS):
            treatment, animal = name.split("_")
            path = f"b/{name}.csv" if name.endswith("b2") else f"{name}.csv"
            of_all = {"treatment": treatment, "animal": f"{treatment}-{animal[0]}", "specimen": animal}
            of_all |= {"x_m": f"{2e-3 * (number % 4)}", "y_m": f"{2e-3 * (number // 4)}"}
            table_of_curves.writerow({"curve": path, **of_all, **STATED.get(name, {})})


def write_stack(path: Path) -> None:
    """Write three curves below one another, each with its number in a column."""
    curves = [np.column_stack([press(20 + k), np.full(200, k)]) for k in range(3)]
    table = np.vstack(curves)
    table[:, 0] = np.arange(len(table)) / 200
    write_table(path, table, f"{HEAD},curve")


def write_sweep(path: Path) -> None:
    """Write G' and G'' of a standard linear solid over frequency, as a rheometer's program does."""
    frequency = np.geomspace(0.1, 20.0, 15)
    noise = np.exp(0.01 * np.random.default_rng(30).standard_normal((15, 2)))
    loss = 2j * np.pi * frequency * 0.1
    modulus = 20e3 + 10e3 * loss / (1.0 + loss)
    table = np.column_stack([frequency, np.column_stack([modulus.real, modulus.imag]) * noise])
    write_table(path, table, "Frequency (Hz),Storage Modulus (Pa),Loss Modulus (Pa)")


def write_shake(path: Path) -> None:
    """Write two shakes of 163 g in free air at 5 Hz with pauses; the force is 7 ms late."""
    random = np.random.default_rng(31)
    time = np.arange(0.0, 18.0, 2e-3)

    def height(instant: Floats) -> Floats:
        """Return the height [m]: shakes of 6 s after pauses of 2 s, each beginning and ending softly."""
        phase = instant % 8.0 - 2.0
        window = np.clip(np.minimum(phase, 6.0 - phase) / 0.5, 0.0, 1.0)
        soft = window**3 * (10.0 - 15.0 * window + 6.0 * window**2) * (instant < 16.0)
        return np.asarray(50e-3 + 2.5e-3 * soft * np.sin(2 * np.pi * 5.0 * phase))

    step = 1e-4
    velocity = (height(time + step) - height(time - step)) / (2 * step)
    late = time - 7e-3
    acceleration = (height(late + step) - 2 * height(late) + height(late - step)) / step**2
    force = -0.163 * (acceleration + 9.80665) + 5e-3 * random.standard_normal(len(time))
    position = height(time) + 1e-6 * random.standard_normal(len(time))
    write_table(path, np.column_stack([time, force, position, velocity]), "time_s,force_N,height_m,velocity_m_s")

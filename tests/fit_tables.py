"""A folder of fits of many curves as `palpate fit` leaves it, with values that are given and not fitted."""

import csv

import numpy as np
from palpate_kit.curves.curve_fits import settings_key

_PIPELINE = """[indenter.tip]
type = "sphere"
radius = 0.003

[model.dr]
type = "dimensionality-reduction"
indenter = "tip"
"""
_VALUE = ("elasticity", "elasticity_std", "elasticity_combined", "elasticity_verdict")
_SURFACE = ("surface", "surface_std", "surface_combined")
_TAIL = ("rms", "samples", "x", "y", "verdict", "conditions", "needs", "flags", "settings", "error")


def write_fits(folder, values, columns):
    """Fits of curves with values [Pa], and `columns` of curves.csv, by the names of the curves."""
    folder.mkdir(parents=True)
    (folder / "pipeline.toml").write_text(_PIPELINE)
    head = ("curve", "track", *_VALUE, *_SURFACE, *_TAIL)
    with (folder / "fits.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.DictWriter(file, head, restval="", lineterminator="\n")
        table.writeheader()
        for name, value in values.items():
            table.writerow({
                "curve": name, "track": "dr/fit", "elasticity": repr(float(value)), "elasticity_std": "300.0",
                "elasticity_combined": "1600.0", "elasticity_verdict": "good", "surface": "0.0", "rms": "0.02",
                "samples": "400", "verdict": "good", "settings": settings_key(_PIPELINE, ()),
            })  # fmt: skip
    with (folder / "curves.csv").open("w", encoding="utf-8", newline="") as file:
        names = list(dict.fromkeys(name for cells in columns.values() for name in cells))
        table = csv.DictWriter(file, ["curve", *names], restval="", lineterminator="\n")
        table.writeheader()
        table.writerows({"curve": name, **cells} for name, cells in columns.items())
    return folder


def draw_animals(folder, groups=2, animals=5, curves=40, shift=0.0, seed=0):
    """Fits of curves of animals in groups: animals scatter by 10 kPa about 100 kPa, curves of one by 3 kPa."""
    random = np.random.default_rng(seed)
    values, columns = {}, {}
    for group in range(groups):
        for animal in range(animals):
            mean = 100e3 + shift * group + 10e3 * random.standard_normal()
            for curve in range(curves):
                name = f"curves/{group}-{animal}-{curve}.csv"
                values[name] = mean + 3e3 * random.standard_normal()
                columns[name] = {
                    "treatment": f"t{group}", "animal": f"{group}-{animal}", "site": f"s{curve % 4}",
                }  # fmt: skip
    return write_fits(folder, values, columns)

"""Maps of a microscope as files in the public layouts of JPK (a zip of properties and channels) and afmformats (HDF5).

Every curve is a press of a known elasticity, whose numbers are the same in a map as in a file of its own.
"""

import warnings
import zipfile
from pathlib import Path

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import afmformats

RADIUS, STIFFNESS, SENSITIVITY, RATE = 5e-6, 0.05, 7e-8, 2000.0  # [m], [N/m], [m/V], [Hz]
COUNT = 300  # readings of each way
FORCE_DIGIT, HEIGHT_DIGIT = 1e-5, 1e-11  # of the channels: [V], [m]


def press(elasticity, seed=0, count=COUNT):
    """The height [m] of the cantilever and the force [N] (2 count,) of a press on a half-space, in and out."""
    way = np.linspace(-1.5e-6, 8e-7, count)
    depth = np.concatenate([way, way[::-1]])
    force = 16 / 9 * elasticity * np.sqrt(RADIUS) * np.maximum(depth, 0.0) ** 1.5
    force += 5e-12 * np.random.default_rng(seed).standard_normal(len(depth))
    return 5e-7 - depth - force / STIFFNESS, force


def places(columns, rows, pitch=1e-6):
    """The places (columns rows, 2) [m] of a grid, row by row, as a map is scanned."""
    return [(pitch * (k % columns), pitch * (k // columns)) for k in range(columns * rows)]


def jpk_file(path, presses, grid=None, pitch=1e-6, broken=()):
    """Write presses by their numbers as a map of JPK, without a grid as one curve; `broken` ones lack their force."""
    kind = "quantitative-imaging-map" if str(path).endswith("qi-data") else "force-scan-map"
    with zipfile.ZipFile(path, "w") as archive:
        head = {"type": kind}
        if grid is not None:
            columns, rows = grid
            pattern = f"{kind}.position-pattern.grid."
            head |= {f"{pattern}xcenter": pitch * (columns - 1) / 2, f"{pattern}ycenter": pitch * (rows - 1) / 2}
            head |= {f"{pattern}ulength": pitch * columns, f"{pattern}vlength": pitch * rows}
            head |= {f"{pattern}ilength": columns, f"{pattern}jlength": rows}
            archive.writestr("index/", "")
        else:
            head |= {f"{kind}.header.position-index": 0}
        archive.writestr("header.properties", _properties(head))
        archive.writestr("shared-data/header.properties", _properties(_shared()))
        for number, (height, force) in presses.items():
            folder = "" if grid is None else f"index/{number}/"
            if folder:
                archive.writestr(folder, "")
                x, y = pitch * (number % columns), pitch * (number // columns)
                of_curve = {f"{kind}.header.position.x": x, f"{kind}.header.position.y": y}
                archive.writestr(
                    f"{folder}header.properties", _properties({f"{kind}.header.position-index": number, **of_curve})
                )
            _write_segments(archive, folder, height, force, number in broken)
    return Path(path)


def _write_segments(archive, folder, height, force, is_broken):
    """Write the way in and the way out of a curve, as whole numbers of their channels."""
    archive.writestr(f"{folder}segments/", "")
    count = len(force) // 2
    volts = np.rint(force / (STIFFNESS * SENSITIVITY) / FORCE_DIGIT).astype(">i4")
    steps = np.rint(height / HEIGHT_DIGIT).astype(">i4")
    for k, style in enumerate(("extend", "retract")):
        rows, of_segment = slice(k * count, (k + 1) * count), f"{folder}segments/{k}/"
        archive.writestr(of_segment, "")
        archive.writestr(f"{of_segment}segment-header.properties", _properties(_segment(style, height[rows])))
        for name, numbers in (("vDeflection", volts), ("measuredHeight", steps)):
            if not (is_broken and name == "vDeflection"):
                archive.writestr(f"{of_segment}channels/{name}.dat", numbers[rows].tobytes())


def _segment(style, height):
    """Properties of one segment; those of its channels are shared."""
    settings = "force-segment-header.settings."
    return {
        f"{settings}style": style,
        f"{settings}segment-settings.duration": len(height) / RATE,
        f"{settings}segment-settings.z-start": height[0],
        f"{settings}segment-settings.z-end": height[-1],
        f"{settings}segment-settings.setpoint": 1.0,
        "force-segment-header.duration": len(height) / RATE,
        "force-segment-header.num-points": len(height),
        "force-segment-header.approach-id": "made",
        "force-segment-header.time-stamp": "2020-01-01 12:00:00.000 +0000",
        "channel.vDeflection.lcd-info.*": 0,
        "channel.measuredHeight.lcd-info.*": 1,
    }


def _shared():
    """Properties of the two channels: volts by sensitivity and spring constant, the height as it is."""
    force, height = "lcd-info.0.", "lcd-info.1."
    table = {}
    for head, unit, digit in ((force, "V", FORCE_DIGIT), (height, "m", HEIGHT_DIGIT)):
        table |= {f"{head}encoder.type": "signedinteger", f"{head}encoder.scaling.offset": 0.0}
        table |= {f"{head}encoder.scaling.multiplier": digit, f"{head}encoder.scaling.unit.unit": unit}
    of_force, of_height = f"{force}conversion-set.conversion", f"{height}conversion-set.conversion"
    table |= {f"{of_force}s.base": "volts", f"{of_force}s.default": "force", f"{of_height}s.base": "nominal"}
    table |= {f"{of_height}s.default": "nominal", f"{of_height}.nominal.name": "Nominal"}
    table |= {f"{height}data.encoder.scaling.unit.unit": "m"}
    for slot, base, factor, unit in (
        ("distance", "volts", SENSITIVITY, "m"),
        ("force", "distance", STIFFNESS, "N"),
    ):
        conversion = f"{of_force}.{slot}."
        table |= {f"{conversion}base-calibration-slot": base, f"{conversion}scaling.offset": 0.0}
        table |= {f"{conversion}scaling.multiplier": factor, f"{conversion}scaling.unit.unit": unit}
        table |= {f"{conversion}name": slot}
    return table


def _properties(table):
    return "".join(f"{key}={value}\n" for key, value in table.items())


def hdf5_file(path, presses, grid=None, pitch=1e-6):
    """Write presses by their numbers through afmformats, with the places of a grid."""
    import h5py

    with h5py.File(path, "w") as file:
        for number, (height, force) in presses.items():
            count = len(force) // 2
            data = {
                "force": force,
                "height (measured)": height,
                "time": np.arange(len(force)) / RATE,
                "segment": np.repeat([0, 1], count).astype(np.uint8),
            }
            facts = {"spring constant": STIFFNESS, "imaging mode": "force-distance", "enum": number, "path": "made"}
            facts |= {"session id": "made", "curve id": str(number), "duration approach": count / RATE}
            facts |= {"point count": len(force)}
            if grid is not None:
                x, y = pitch * (number % grid[0]), pitch * (number // grid[0])
                facts |= {"position x": x, "position y": y}
            afmformats.AFMForceDistance(data, facts).export_data(file, fmt="hdf5")
    return Path(path)

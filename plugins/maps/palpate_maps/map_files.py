"""Maps and lumps as files: CSV for tables, NPZ for arrays, JSON for programs."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from palpate import Floats, OutputError
from palpate_engine import bounded_text, write_whole

from palpate_maps.hidden_patches import Hiding
from palpate_maps.lump_criteria import Findings, LumpPower
from palpate_maps.map_grid import StiffnessMap
from palpate_maps.path_reader import Path2D
from palpate_maps.sites import Sites


def map_csv(field: StiffnessMap, parameter: str) -> str:
    """Return one row for each cell: x, y, value, standard deviation, covered, p-value, stiffer than the baseline."""
    rows = [f"x_m,y_m,{parameter},{parameter}_std,covered,p,stiff"]
    for j, y in enumerate(field.y):
        for i, x in enumerate(field.x):
            is_covered = bool(field.covered[j, i])
            cells = f"{field.value[j, i]:.6g},{field.std[j, i]:.4g}" if is_covered else ","
            p = f"{field.p[j, i]:.3g}" if is_covered else ""
            rows.append(f"{x:.6f},{y:.6f},{cells},{int(is_covered)},{p},{int(field.stiff[j, i])}")
    return "\n".join(rows) + "\n"


def sweep_csv(series: Mapping[str, tuple[Floats, Sites]], parameter: str) -> str:
    """Return one row for each site of each track: coordinate along the sweep, place, value, standard deviation."""
    rows = [f"track,along_m,x_m,y_m,{parameter},{parameter}_std"]
    for track, (along, sites) in series.items():
        for coordinate, (x, y), value, std in zip(along, sites.place, sites.value, sites.std, strict=True):
            rows.append(f"{track},{coordinate:.6f},{x:.6f},{y:.6f},{value:.6g},{value * std:.4g}")
    return "\n".join(rows) + "\n"


def map_npz(field: StiffnessMap, parameter: str) -> bytes:
    """Return the arrays x, y, value, std, covered, p, stiff, sites, and the parameter's name."""
    file = io.BytesIO()
    np.savez_compressed(
        file,
        x=field.x,
        y=field.y,
        value=field.value,
        std=field.std,
        covered=field.covered,
        p=field.p,
        stiff=field.stiff,
        sites=field.sites,
        parameter=np.array(parameter),
    )
    return file.getvalue()


def hiding_csv(hiding: Hiding) -> str:
    """Return one row for each place: x, y, on a surface z, and the patches still expected with their middle there."""
    places = zip(hiding.middles, hiding.expected, strict=True)
    rows = [",".join([*(f"{coordinate:.6f}" for coordinate in place), f"{number:.4g}"]) for place, number in places]
    head = ",".join(f"{axis}_m" for axis, _ in zip("xyz", hiding.middles.T))
    return "\n".join([f"{head},expected_patches", *rows]) + "\n"


def lumps_json(findings: Findings, path: Path2D) -> str:
    """Return the lumps of a path's estimates as JSON: place, extent, contrast and p-value [SI]."""
    table = {
        "track": path.track,
        "other_tracks": path.others,
        "parameter": path.parameter,
        "method": findings.method,
        "background": findings.background,
        "spread": findings.spread,
        "warning": findings.warning,
        "power": None if findings.power is None else _power(findings.power),
        "excluded": exclusion_table(findings),
        "excluded_where": findings.excluded_where,
        "response": None if findings.response is None else vars(findings.response),
        "lumps": [
            {
                "x": lump.place[0],
                "y": lump.place[1],
                **({} if lump.height is None else {"z": lump.height}),
                "highest": list(lump.highest or lump.place),
                "place_std": None if lump.place_std is None else list(lump.place_std),
                "extent": list(lump.extent),
                "extent_std": None if lump.width_std is None else [lump.width_std * size for size in lump.extent],
                "size": None if lump.size is None else {"value": lump.size[0], "std": lump.size[1]},
                "may_be_two": lump.may_be_two,
                "contrast": lump.contrast,
                "contrast_std": lump.contrast_std,
                "p": lump.p,
            }
            for lump in findings.lumps
        ],
    }
    return json.dumps(table, indent=2, allow_nan=False) + "\n"


def exclusion_table(findings: Findings) -> list[dict[str, float | None]]:
    """Return by width the lumps that an exam excludes; no contrast where none as wide is."""
    return [_power(power) for power in findings.excluded]


def _power(power: LumpPower) -> dict[str, float | None]:
    """Return the width, contrast and probability of a lump; no contrast where none would be found."""
    return {**vars(power), "contrast": power.contrast if math.isfinite(power.contrast) else None}


def free_name(folder: Path, name: str, table: str) -> str:
    """Return a name, such as "map" or "map-2", under which a folder has no table yet, or has just this one."""
    number = 1
    while True:
        candidate = name if number == 1 else f"{name}-{number}"
        files = [path for path in folder.glob(f"{candidate}.*") if path.is_file()]
        if not files or _text_of(folder / f"{candidate}.csv") == table:
            return candidate
        number += 1


def _text_of(path: Path) -> str | None:
    try:
        return bounded_text(path)
    except (OSError, UnicodeDecodeError):
        return None


def replace_file(path: Path, content: str | bytes) -> None:
    """Write a file that can be made again from the run, so it may be replaced; raises OutputError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path}: cannot write: {error.strerror}") from error
    write_whole(path, content)

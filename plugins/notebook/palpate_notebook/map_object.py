"""Maps and curves of a parameter over the places of a run."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from palpate import ConfigurationError, Floats, LogError, to_si
from palpate_maps import map_analysis
from palpate_maps.commands.map_output import outlines_of
from palpate_maps.map_figures import map_picture, sweep_picture

from palpate_notebook.figure_object import Picture
from palpate_notebook.optional_imports import library
from palpate_notebook.run_data import RunData
from palpate_notebook.suggestions import with_suggestions

if TYPE_CHECKING:
    import pandas
    import xarray
    from palpate_maps.map_analysis import Findings, Sites, StiffnessMap


@with_suggestions
@dataclass(frozen=True)
class MapView:
    """Map of a parameter over an area, or curve along a swept line, with its uncertainty and lumps."""

    track: str
    parameter: str
    unit: str  # SI
    sites: Sites
    findings: Findings | None  # None for too few sites
    field: StiffnessMap | None  # None along a line
    outlines: tuple[Floats, ...] = ()  # of the inclusions of a simulated rig

    @property
    def data(self) -> xarray.Dataset:
        """Value and std [SI] over y and x, or along the line; NaN where no site is near."""
        return self._curve_dataset() if self.field is None else self._map_dataset(self.field)

    def _map_dataset(self, field: StiffnessMap) -> xarray.Dataset:
        units = {"units": self.unit}
        columns = {
            "value": (("y", "x"), field.value, units),
            "std": (("y", "x"), field.std, units),
            "stiff": (("y", "x"), field.stiff),
        }
        coordinates = {"x": ("x", field.x, {"units": "m"}), "y": ("y", field.y, {"units": "m"})}
        dataset: xarray.Dataset = library("xarray").Dataset(columns, coordinates)
        return dataset

    def _curve_dataset(self) -> xarray.Dataset:
        units = {"units": self.unit}
        along = self._line_coordinate()
        order = along.argsort()
        value = self.sites.value[order]
        relative_std = self.sites.std[order]
        columns = {"value": ("along", value, units), "std": ("along", value * relative_std, units)}
        coordinates = {"along": ("along", along[order], {"units": "m"})}
        dataset: xarray.Dataset = library("xarray").Dataset(columns, coordinates)
        return dataset

    @property
    def lumps(self) -> pandas.DataFrame:
        """A row for each lump: place [m], contrast, its std, p; without rows for too few sites."""
        lumps = self.findings.lumps if self.findings is not None else ()
        rows = [
            {"x": lump.place[0], "y": lump.place[1], "contrast": lump.contrast, "std": lump.contrast_std, "p": lump.p}
            for lump in lumps
        ]
        return library("pandas").DataFrame(rows, columns=["x", "y", "contrast", "std", "p"])

    def plot(self) -> Picture:
        """Return the map with its standard deviation and the lumps, or the curve along the line."""
        if self.field is not None:
            return Picture(map_picture(self.field, self.parameter, self.unit, self.findings, self.outlines))
        curve = {self.track: (self._line_coordinate(), self.sites)}
        return Picture(sweep_picture(curve, self.parameter, self.unit, self.findings))

    def _line_coordinate(self) -> Floats:
        """Return the coordinate [m] of each site (n,) along the line."""
        along = map_analysis.line_coordinate(self.sites)
        assert along is not None  # without a map the sites are on a line
        return along

    def __repr__(self) -> str:
        shape = "Map" if self.field is not None else "Curve"
        lumps = len(self.findings.lumps) if self.findings is not None else "no"
        return f"<{shape} of {self.parameter} by {self.track}: {len(self.sites)} sites, {lumps} lumps; .plot(), .data>"


def map_of(
    run: RunData,
    track: str | None,
    parameter: str | None,
    cell: str | float,
    method: Literal["gaussian-process", "average"] = "gaussian-process",
) -> MapView:
    """Return the map of a parameter, or its curve if the run swept a line; `cell`: size of a cell of the map [m].

    Raises LogError for too few places, ConfigurationError for arguments that are invalid.
    """
    if method not in ("gaussian-process", "average"):
        raise ConfigurationError(f'method: {method!r} is not one of "gaussian-process" and "average"')
    try:
        cell_size = to_si(cell, "m")
    except ValueError as error:
        raise ConfigurationError(f"cell: {error}") from error
    path = map_analysis.read_path(run.folder, track, parameter)
    sites = map_analysis.sites_along(path)
    findings = None
    with suppress(LogError):  # too few sites for lumps are enough for a map
        findings = map_analysis.find_lumps(sites)
    is_line = map_analysis.line_coordinate(sites) is not None and not sites.standing.all()
    return MapView(
        track=path.track,
        parameter=path.parameter,
        unit=run.document["tracks"][path.track]["parameters"][path.parameter]["unit"],
        sites=sites,
        findings=findings,
        field=None if is_line else map_analysis.make_map(sites, cell_size, method),
        outlines=() if is_line else tuple(outlines_of(run.folder)),
    )

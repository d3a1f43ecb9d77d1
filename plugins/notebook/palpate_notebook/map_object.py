"""Maps and curves: a parameter over the places of a run."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from palpate import ConfigurationError, Floats, LogError, to_si
from palpate_maps import map_analysis
from palpate_maps.commands.map_command import outlines_of
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
    """A parameter over an area, or along a line that was swept, with its uncertainty and the lumps in it."""

    track: str
    parameter: str
    unit: str  # SI
    sites: Sites
    findings: Findings | None  # None where there are too few sites
    field: StiffnessMap | None  # None along a line
    outlines: tuple[Floats, ...] = ()  # of what a simulated rig hides

    @property
    def data(self) -> xarray.Dataset:
        """Value and std [SI] over y and x, or along the line; NaN where no site is near."""
        units, length = {"units": self.unit}, {"units": "m"}
        if self.field is not None:
            found = self.field
            area: xarray.Dataset = library("xarray").Dataset(
                {
                    "value": (("y", "x"), found.value, units),
                    "std": (("y", "x"), found.std, units),
                    "stiff": (("y", "x"), found.stiff),
                },
                {"x": ("x", found.x, length), "y": ("y", found.y, length)},
            )
            return area
        along, value = self._curve
        columns = {"value": ("along", value, units), "std": ("along", value * self._std, units)}
        curve: xarray.Dataset = library("xarray").Dataset(columns, {"along": ("along", along, length)})
        return curve

    @property
    def lumps(self) -> pandas.DataFrame:
        """A row for each lump: place [m], contrast, its std, p; none where there are too few sites."""
        found = self.findings.lumps if self.findings is not None else ()
        rows = [
            {"x": lump.place[0], "y": lump.place[1], "contrast": lump.contrast, "std": lump.contrast_std, "p": lump.p}
            for lump in found
        ]
        return library("pandas").DataFrame(rows, columns=["x", "y", "contrast", "std", "p"])

    def plot(self) -> Picture:
        """Return the map with its standard deviation and the lumps, or the curve along the line."""
        if self.field is not None:
            return Picture(map_picture(self.field, self.parameter, self.unit, self.findings, self.outlines))
        along = map_analysis.line_coordinate(self.sites)
        assert along is not None
        return Picture(sweep_picture({self.track: (along, self.sites)}, self.parameter, self.unit, self.findings))

    @property
    def _order(self) -> Any:
        along = map_analysis.line_coordinate(self.sites)
        assert along is not None
        return along, along.argsort()

    @property
    def _curve(self) -> tuple[Floats, Floats]:
        along, order = self._order
        return along[order], self.sites.value[order]

    @property
    def _std(self) -> Floats:
        _, order = self._order
        found: Floats = self.sites.std[order]
        return found

    def __repr__(self) -> str:
        kind = "Map" if self.field is not None else "Curve"
        lumps = len(self.findings.lumps) if self.findings is not None else "no"
        return f"<{kind} of {self.parameter} by {self.track}: {len(self.sites)} sites, {lumps} lumps; .plot(), .data>"


def map_of(
    run: RunData,
    track: str | None,
    parameter: str | None,
    cell: str | float,
    method: Literal["gaussian-process", "average"] = "gaussian-process",
) -> MapView:
    """Return the map, or the curve along a line; raises LogError where there are too few places, ConfigurationError."""
    if method not in ("gaussian-process", "average"):
        raise ConfigurationError(f'method: {method!r} is not one of "gaussian-process" and "average"')
    try:
        size = to_si(cell, "m")
    except ValueError as error:
        raise ConfigurationError(f"cell: {error}") from error
    path = map_analysis.read_path(run.folder, track, parameter)
    sites = map_analysis.sites_along(path)
    findings = None
    with suppress(LogError):  # too few sites for lumps are enough for a map
        findings = map_analysis.find_lumps(sites)
    unit = run.document["tracks"][path.track]["parameters"][path.parameter]["unit"]
    along = map_analysis.line_coordinate(sites)
    line = along is not None and not sites.standing.all()
    field = None if line else map_analysis.make_map(sites, size, method)
    outlines = () if line else tuple(outlines_of(run.folder))
    return MapView(path.track, path.parameter, unit, sites, findings, field, outlines)

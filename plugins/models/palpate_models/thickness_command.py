"""``palpate model thickness``: the factor of a specimen of any size under a tip, by finite elements, as a table."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from palpate import ConfigurationError, Floats, Indenter, tip_profile, to_si
from palpate_engine import Source, build_parts, write_new
from palpate_kit.terminal.json_output import print_json
from palpate_kit.terminal.options import JsonOption

from palpate_models.indenters.power_profiles import Flat

if TYPE_CHECKING:
    from palpate_models.finite_elements import Cylinder
    from palpate_models.rigid_tip import TipProfile

_BEYOND = 1.6  # contact radii out to which the surface is looked at
_FIRST = 0.3  # contact radius of the first row, over that of the last: less, and it spans few elements
_SCATTER = 0.03  # of rows about their curve: more, and they are not a table
_DEEPER = 4.0  # depths out to which the tip's profile is known
_NO_SHAPE = ("TruncatedCone", "TiltedFlat", "NeoHookeanSphere")


def thickness(
    diameter: Annotated[str, typer.Option(help="Diameter of the round specimen, such as '50 mm'.")],
    height: Annotated[str, typer.Option(help="Its height, such as '22 mm'.")],
    tip: Annotated[str, typer.Option(help="A tip by its type, such as exact-sphere.")] = "exact-sphere",
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Of the tip: radius='5 mm'.")
    ] = None,
    depth: Annotated[str, typer.Option(help="Deepest depth of the table.")] = "5 mm",
    points: Annotated[int, typer.Option(help="Rows of the table.", min=5, max=100)] = 10,
    bonded: Annotated[bool, typer.Option("--bonded/--sliding", help="Whether the base holds the specimen.")] = True,
    sticking: Annotated[bool, typer.Option("--sticking", help="The surface does not slide on the tip.")] = False,
    fine: Annotated[int, typer.Option(help="Elements across the contact.", min=8, max=200)] = 20,
    limit: Annotated[str, typer.Option(help="Time after which the rows found so far are the table.")] = "10 min",
    out: Annotated[Path, typer.Option("--out", "-o", help="CSV file; must be new.")] = Path("thickness.csv"),
    as_json: JsonOption = False,
) -> None:
    """Compute by how much a specimen of a size is stiffer than a half-space, for `thickness = { table = "..." }`.

    Finite elements, axisymmetric, neo-Hookean, nearly incompressible, large deformations, contact without friction;
    some seconds for each row. A flat tip's edge is rounded over a tenth of its radius. The factor is the force over
    that of the tip on a half-space at small strain. Where no equilibrium is found, or the time is over, the table ends
    at the last depth that was reached, and this is said.
    """
    from palpate_models.finite_elements import Cylinder
    from palpate_models.thickness_table import smooth_table, table_text, tip_facts

    if out.exists():
        raise ConfigurationError(f"{out}: exists already, and nothing is ever overwritten")
    sizes = {name: _length(name, text) for name, text in (("diameter", diameter), ("height", height), ("depth", depth))}
    indenter = _tip(tip, overrides or [])
    profile = _fitting(indenter, sizes, sticking)
    depths = sizes["depth"] * np.linspace(_FIRST, 1.0, points) ** 2
    cylinder = Cylinder(sizes["diameter"], sizes["height"], bonded)
    factors, stopped = _rows(cylinder, indenter, profile, depths, fine, _seconds(limit))
    reached = depths[: len(factors)]
    smooth, scatter, at_touch = smooth_table(reached, factors, isinstance(indenter, Flat))
    if scatter > _SCATTER:
        raise ConfigurationError(
            f"palpate model thickness: the rows scatter by {scatter:.1%}; take more elements (--fine)"
        )
    facts = {
        "tip": tip_facts(indenter), "diameter": sizes["diameter"], "height": sizes["height"], "bonded": bonded,
        "sticking": sticking, "elements": fine, "scatter": float(f"{scatter:.2g}"),
        **({"at_touch": float(f"{at_touch:.6g}")} if isinstance(indenter, Flat) else {}),
    }  # fmt: skip
    write_new(out, table_text(facts, reached, smooth))
    if as_json:
        print_json({"file": out, **facts, "depth": reached, "factor": smooth, "computed": factors, "stopped": stopped})
    typer.echo(f"a curve through the rows misses them by up to {scatter:.2%}: the table holds the curve", err=True)
    if stopped:
        typer.echo(f"warning: {stopped}: the table ends at {1e3 * reached[-1]:.3g} mm, not at {depth}", err=True)
    typer.echo(f'written to {out}; use it with thickness = {{ table = "{out}" }}', err=as_json)


def _fitting(tip: Indenter, sizes: dict[str, float], sticking: bool) -> TipProfile:
    """The tip's shape, where it fits the specimen; raises ConfigurationError."""
    if sizes["depth"] > 0.5 * sizes["height"]:
        raise ConfigurationError("--depth: more than half of the height")
    profile = _profile(tip, sizes["depth"], sticking)
    if profile.reach > 0.5 * sizes["diameter"]:
        raise ConfigurationError("--diameter: the contact would reach the specimen's edge")
    return profile


def _rows(
    cylinder: Cylinder, tip: Indenter, profile: TipProfile, depths: Floats, fine: int, seconds: float
) -> tuple[Floats, str]:
    """Factors of as many depths as were reached, and why not of all; raises ConfigurationError where they are few."""
    from palpate_models.thickness_table import FEWEST

    found, stopped = list[float](), ""
    for one in _factors(cylinder, tip, profile, depths, fine, seconds):
        if isinstance(one, str):
            stopped = one
        else:
            found.append(one)
    if len(found) < FEWEST:
        raise ConfigurationError(
            f"palpate model thickness: {stopped}, and {len(found)} rows are not a table ({FEWEST} needed); take less "
            "--depth, more --points, more --limit, or another number of elements (--fine)"
        )
    return np.array(found), stopped


def _factors(
    cylinder: Cylinder, tip: Indenter, profile: TipProfile, depths: Floats, fine: int, seconds: float
) -> Iterator[float | str]:
    """Factors, reported as they come; last, where not all are found, why."""
    from palpate_models.finite_elements import NoEquilibriumError, press_cylinder

    began = time.monotonic()
    forces = press_cylinder(cylinder, lambda depth: _shape(tip, profile, depth)[0], depths, fine, began + seconds)
    for number, depth in enumerate(depths.tolist(), start=1):
        try:
            factor = next(forces) / (8.0 / 3.0 * _shape(tip, profile, depth)[1])
        except NoEquilibriumError as error:
            yield str(error)
            return
        line = f"{number}/{len(depths)}: {1e3 * depth:.4g} mm: {factor:.4f} ({time.monotonic() - began:.0f} s)"
        typer.echo(line, err=True)
        yield factor


def _shape(tip: Indenter, profile: TipProfile, depth: float) -> tuple[TipProfile, float]:
    """The tip as the elements take it at a depth, and its area A [m^2]: on a half-space the force is 2 E* A."""
    from palpate_models.rigid_tip import rounded_flat

    if isinstance(tip, Flat):
        return rounded_flat(tip.radius, depth, profile.sticking)
    return profile, float(tip.profile_area(depth))


def _seconds(text: str) -> float:
    try:
        value = to_si(text, "s")
    except ValueError as error:
        raise ConfigurationError(f"--limit: {error}") from error
    if not value > 0:
        raise ConfigurationError(f"--limit: {text!r} is not a computing time")
    return value


def _length(name: str, text: str) -> float:
    try:
        value = to_si(text, "m")
    except ValueError as error:
        raise ConfigurationError(f"--{name}: {error}") from error
    if not 0 < value < 10:
        raise ConfigurationError(f"--{name}: {text!r} is not a length of a specimen")
    return value


def _tip(name: str, overrides: list[str]) -> Indenter:
    source = Source(f'[indenter.tip]\ntype = "{name}"\n', Path("palpate model thickness"))
    for assignment in overrides:
        source.override(f"indenter.tip.{assignment}")
    found: Indenter = build_parts(source, "indenter")["tip"]
    if type(found).__name__ in _NO_SHAPE:
        raise ConfigurationError(f"--tip {name}: has a sharp edge, or is not a shape; the elements need a smooth tip")
    return found


def _profile(indenter: Indenter, depth: float, sticking: bool) -> TipProfile:
    """The tip's shape out to where it may touch, straight on beyond what is known of it."""
    from scipy.interpolate import CubicSpline

    from palpate_models.rigid_tip import TipProfile, rounded_flat

    if isinstance(indenter, Flat):
        return rounded_flat(indenter.radius, depth, sticking)[0]
    radii, heights = tip_profile(indenter, _DEEPER * depth, 400)
    shape = CubicSpline(radii, heights)
    last, top, rise = float(radii[-1]), float(heights[-1]), float(shape(radii[-1], 1))
    reach = _BEYOND * float(np.real(indenter.contact_radius(depth)))

    def height(r: Any) -> Any:
        return np.where(np.abs(r) < last, shape(np.clip(np.abs(r), 0.0, last)), top + rise * (np.abs(r) - last))

    def slope(r: Any) -> Any:
        return np.sign(r) * np.where(np.abs(r) < last, shape(np.clip(np.abs(r), 0.0, last), 1), rise)

    return TipProfile(height, slope, reach, sticking)

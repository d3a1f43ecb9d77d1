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

_REACH = 1.6  # contact radii, a choice: how far out the surface may touch the tip
_FIRST_RADIUS_RATIO = (
    0.3  # a choice: contact radius of the first row over that of the last; a smaller one spans few elements
)
_MAX_SCATTER = 0.03  # a choice: rows that scatter more about their curve are not a table
_PROFILE_DEPTHS = 4.0  # a choice: depths to which the tip's profile is taken
_PROFILE_POINTS = 400  # a choice: points of that profile
_MAX_STRAIN = 0.5  # depth over height, a choice: deeper no equilibrium is reliable
_MAX_LENGTH = 10.0  # [m], a choice: no specimen is larger
_NO_SHAPE = ("TruncatedCone", "TiltedFlat", "NeoHookeanSphere")


def thickness(
    diameter: Annotated[str, typer.Option(help="Diameter of the round specimen, such as '50 mm'.")],
    height: Annotated[str, typer.Option(help="Its height, such as '22 mm'.")],
    tip: Annotated[str, typer.Option(help="A tip by its type, such as exact-sphere.")] = "exact-sphere",
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Of the tip: radius='5 mm'.")
    ] = None,
    depth: Annotated[str, typer.Option(help="Deepest depth of the table.")] = "5 mm",
    # Choices: more rows and elements take longer; the rows determine a curve of five coefficients.
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
    texts = {"diameter": diameter, "height": height, "depth": depth}
    sizes = {name: _length(name, text) for name, text in texts.items()}
    indenter = _tip(tip, overrides or [])
    profile = _profile_within(indenter, sizes, sticking)
    cylinder = Cylinder(sizes["diameter"], sizes["height"], bonded)
    # Contact radii at even distances: that of a sphere grows with the root of the depth.
    depths = sizes["depth"] * np.linspace(_FIRST_RADIUS_RATIO, 1.0, points) ** 2
    factors, stopped = _compute_rows(
        cylinder, tip=indenter, profile=profile, depths=depths, fine=fine, seconds=_seconds(limit)
    )
    # A smooth curve through the rows is the table; their scatter about it shows whether the elements were fine enough.
    reached = depths[: len(factors)]
    smooth, scatter, at_touch = smooth_table(reached, factors, isinstance(indenter, Flat))
    if scatter > _MAX_SCATTER:
        raise ConfigurationError(
            f"palpate model thickness: the rows scatter by {scatter:.1%}; take more elements (--fine)"
        )
    facts = {
        "tip": tip_facts(indenter),
        "diameter": sizes["diameter"],
        "height": sizes["height"],
        "bonded": bonded,
        "sticking": sticking,
        "elements": fine,
        "scatter": float(f"{scatter:.2g}"),
    }
    if isinstance(indenter, Flat):
        facts["at_touch"] = float(f"{at_touch:.6g}")
    write_new(out, table_text(facts, reached, smooth))
    if as_json:
        print_json({"file": out, **facts, "depth": reached, "factor": smooth, "computed": factors, "stopped": stopped})
    typer.echo(f"a curve through the rows misses them by up to {scatter:.2%}: the table holds the curve", err=True)
    if stopped:
        typer.echo(f"warning: {stopped}: the table ends at {1e3 * reached[-1]:.3g} mm, not at {depth}", err=True)
    typer.echo(f'written to {out}; use it with thickness = {{ table = "{out}" }}', err=as_json)


def _profile_within(tip: Indenter, sizes: dict[str, float], sticking: bool) -> TipProfile:
    """Return the tip's shape; raises ConfigurationError where it does not fit the specimen."""
    if sizes["depth"] > _MAX_STRAIN * sizes["height"]:
        raise ConfigurationError("--depth: more than half of the height")
    profile = _profile(tip, sizes["depth"], sticking)
    if profile.reach > 0.5 * sizes["diameter"]:
        raise ConfigurationError("--diameter: the contact would reach the specimen's edge")
    return profile


def _compute_rows(
    cylinder: Cylinder, tip: Indenter, profile: TipProfile, depths: Floats, fine: int, seconds: float
) -> tuple[Floats, str]:
    """Return the factors of the reached depths, and the reason for the end; raises ConfigurationError if few."""
    from palpate_models.thickness_table import MIN_ROWS

    factors, stopped = list[float](), ""
    for outcome in _factors(cylinder, tip, profile, depths, fine, seconds):
        if isinstance(outcome, str):
            stopped = outcome
        else:
            factors.append(outcome)
    if len(factors) < MIN_ROWS:
        raise ConfigurationError(
            f"palpate model thickness: {stopped}, and {len(factors)} rows are not a table ({MIN_ROWS} needed); "
            "take less --depth, more --points, more --limit, or another number of elements (--fine)"
        )
    return np.array(factors), stopped


def _factors(
    cylinder: Cylinder, tip: Indenter, profile: TipProfile, depths: Floats, fine: int, seconds: float
) -> Iterator[float | str]:
    """Yield factors, each reported when it is computed; last, where the depths end early, the reason.

    The tip's `profile` is followed by `fine` elements across the contact; all depths have `seconds` together.
    """
    from palpate_models.finite_elements import NoEquilibriumError, press_cylinder

    # The half-space has the force 2 E* A = 8/3 E A, of incompressible material.
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
    """Return the tip of the elements at a depth, and its area A [m^2]: on a half-space the force is 2 E* A."""
    from palpate_models.rigid_tip import rounded_flat

    if isinstance(tip, Flat):
        return rounded_flat(tip.radius, depth, profile.sticking)
    return profile, float(tip.profile_area(depth))


def _seconds(text: str) -> float:
    """Return a computing time [s]; raises ConfigurationError for another text."""
    try:
        value = to_si(text, "s")
    except ValueError as error:
        raise ConfigurationError(f"--limit: {error}") from error
    if not value > 0:
        raise ConfigurationError(f"--limit: {text!r} is not a computing time")
    return value


def _length(name: str, text: str) -> float:
    """Return a length [m] of a specimen; raises ConfigurationError, with the option's name, for another text."""
    try:
        value = to_si(text, "m")
    except ValueError as error:
        raise ConfigurationError(f"--{name}: {error}") from error
    if not 0 < value < _MAX_LENGTH:
        raise ConfigurationError(f"--{name}: {text!r} is not a length of a specimen")
    return value


def _tip(name: str, overrides: list[str]) -> Indenter:
    """Return a tip by its type and assignments; raises ConfigurationError for one that is not smooth."""
    source = Source(f'[indenter.tip]\ntype = "{name}"\n', Path("palpate model thickness"))
    for assignment in overrides:
        source.override(f"indenter.tip.{assignment}")
    indenter: Indenter = build_parts(source, "indenter")["tip"]
    if type(indenter).__name__ in _NO_SHAPE:
        raise ConfigurationError(f"--tip {name}: has a sharp edge, or is not a shape; the elements need a smooth tip")
    return indenter


def _profile(indenter: Indenter, depth: float, sticking: bool) -> TipProfile:
    """Return the tip's shape as far as it may touch; beyond its known profile it is straight."""
    from scipy.interpolate import CubicSpline

    from palpate_models.rigid_tip import TipProfile, rounded_flat

    if isinstance(indenter, Flat):
        return rounded_flat(indenter.radius, depth, sticking)[0]
    radii, heights = tip_profile(indenter, _PROFILE_DEPTHS * depth, _PROFILE_POINTS)
    shape = CubicSpline(radii, heights)
    # Radius, height and slope at the end of the known profile.
    last, top, rise = float(radii[-1]), float(heights[-1]), float(shape(radii[-1], 1))
    reach = _REACH * float(np.real(indenter.contact_radius(depth)))

    def height(r: Any) -> Any:
        return np.where(np.abs(r) < last, shape(np.clip(np.abs(r), 0.0, last)), top + rise * (np.abs(r) - last))

    def slope(r: Any) -> Any:
        return np.sign(r) * np.where(np.abs(r) < last, shape(np.clip(np.abs(r), 0.0, last), 1), rise)

    return TipProfile(height, slope, reach, sticking)

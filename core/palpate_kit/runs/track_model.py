"""The tables of a track in ``result.json``: its values, budget, flags and fit."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, JsonValue, model_validator

from palpate_kit.runs.run_model import Absent, Count, Document, Number, Open

VERDICT = "^(good|note|doubtful|invalid|not determined|needs .+)$"
_SHARE = "systematic_"
_SHARE_SCHEMA: dict[str, JsonValue] = {
    "type": "number",
    "description": "share of `systematic` from the source that the name ends with",
}


class PlacesDocument(Document):
    """Of a sweep: the values of its places."""

    places: Count = Field(description="how many there are")
    low: Number = Field(description="their 1 % quantile")
    median: Number = Field(description="their median")
    high: Number = Field(description="their 99 % quantile")
    spread: Number = Field(description="their standard deviation")


class LastDocument(Document):
    """Of a sweep: the estimate at its end."""

    value: Number = Field(description="its value")
    std: Number = Field(description="its standard deviation")


class ValueDocument(Document):
    """A value with its uncertainty."""

    model_config = ConfigDict(json_schema_extra={"patternProperties": {f"^{_SHARE}[a-z_]+$": _SHARE_SCHEMA}})

    value: Number = Field(
        description="mean over the last [run] average of the estimates; of a sweep over its places of 1 mm [SI]; what "
        "it is worth, `verdict` says"
    )
    estimate: Number = Field(None, description="of older results: that mean, of what needs a fact or is not determined")
    std: Number = Field(description="standard deviation at the end, as the estimator gives it [SI]")
    unit: str = Field(description="SI unit of all numbers of this table")
    settling: Number = Field(description="standard uncertainty from an estimate that has not come to rest")
    systematic: Number = Field(
        None,
        description="standard uncertainty of everything that is assumed exact; absent where nothing is declared",
    )
    combined: Number = Field(description="standard uncertainty of all parts together; null where it is not known")
    equivalent_delay: Number = Field(
        None, description="lateness of the force that would explain the whole value [s]; eta/G for a viscosity"
    )
    bias: Number = Field(None, description="known bias of the value, with its sign")
    bias_std: Number = Field(
        None, description="standard uncertainty of that bias; null where the bias is too large to be predicted"
    )
    corrected: Number = Field(None, description="value less its known bias")
    corrected_combined: Number = Field(None, description="combined uncertainty of the corrected value")
    verdict: str | Absent = Field(
        None,
        pattern=VERDICT,
        description="good, doubtful, invalid, not determined, or needs and the fact that it needs",
    )
    places: PlacesDocument | Absent = None
    last: LastDocument | Absent = None

    @model_validator(mode="before")
    @classmethod
    def _shares_are_numbers(cls, table: Any) -> Any:
        for key, share in table.items() if isinstance(table, dict) else ():
            if key.startswith(_SHARE) and not isinstance(share, int | float | None):
                raise ValueError(f"{key} must be a valid number")
        return table


class DerivedValueDocument(ValueDocument):
    """A value that follows from the parameters, with its uncertainty."""

    caveat: str = Field(description="what has to hold for it to be a property of the material")


class EvidenceDocument(Document):
    """A sign of what a flag names."""

    code: str = Field(description="for programs")
    message: str = Field(description="a sentence for readers")


class FlagDocument(Document):
    """A failed assumption."""

    code: str = Field(
        pattern="^[a-z0-9]+(-[a-z0-9]+)*$", description="for programs; `palpate describe CODE` says what it means"
    )
    message: str = Field(description="a sentence for readers")
    severity: Literal["note", "doubtful", "invalid"] | None = Field(
        description="what it means for the numbers; null where the code is not registered"
    )
    remedy: str = Field("", description="what to do")
    suspects: list[str] = Field([], description="likely causes by name, the likeliest first")
    moves: list[str] = Field([], description="values that it puts in doubt")
    effects: dict[str, Number] = Field(
        {}, description="by how much it can move each value [SI], by name; null without bound; absent where not known"
    )
    evidence: list[EvidenceDocument] = Field([], description="other signs of the same cause")


class ConditionDocument(Document):
    """A fact that the record cannot show and nobody has stated."""

    fact: str = Field(description="thickness, delay, tare, mass, poisson, ..., or the key of a setting")
    message: str = Field(description="what is assumed, and what becomes of the values otherwise")
    remedy: str = Field(description="the words that state it")
    alternative: str = Field(description="with which the shifts are; empty without one")
    shifts: dict[str, Number] = Field({}, description="of each value by the alternative [SI], by name")
    needed_by: list[str] = Field([], description="values that the alternative moves by more than half")
    code: str = Field("", description="of the flag by which versions before schema 5 said it")


class EffectDocument(Document):
    """Effect of a source on one unknown."""

    sensitivity: Number = Field(description="unit of the unknown per unit of the source")
    contribution: Number = Field(description="standard uncertainty; null where that of the source is not known")
    percent: Number = Field(description="of the value")


class BudgetDocument(Document):
    """One source of uncertainty."""

    source: str = Field(description="its name")
    std: Number = Field(description="its standard uncertainty; null where it is not declared")
    unit: str = Field(description="unit of `std`")
    effects: dict[str, EffectDocument] = Field(description="by unknown")


class CorrelationDocument(Document):
    """One pair of unknowns."""

    first: str = Field(description="an unknown")
    second: str = Field(description="another")
    value: Number = Field(description="correlation, -1 to 1")


class UnknownDocument(Document):
    """One unknown of a fit."""

    value: Number = Field(description="[SI]")
    unit: str = Field(description="SI unit")
    free: bool = Field(description="whether it was looked for, not held")
    std: Number = Field(description="standard uncertainty without timing")
    random: Number = Field(description="of it, from the residuals")
    systematic: Number = Field(description="of it, from what was declared")
    interval: Annotated[list[Number], Field(min_length=2, max_length=2)] | None = Field(description="interval of 95 %")


class FitDocument(Document):
    """Residual and unknowns of an offline fit."""

    rss: Number = Field(description="sum of the squared residuals [N^2]")
    samples: Count = Field(description="that were fitted")
    unknowns: dict[str, UnknownDocument] = Field(description="by name")
    correlations: list[CorrelationDocument] = Field(description="of pairs of free unknowns")
    aic: Number = Field(description="Akaike's criterion")
    bic: Number = Field(description="Bayes' criterion")
    basis: str = Field(description="what was fitted; evidence compares fits of one basis")
    autocorrelation: Number = Field(description="of neighbouring residuals")
    effective_samples: Number = Field(description="independent samples that the correlated ones are worth")
    bias: Number = Field(description="that the force reads too much at the middle of the fitted samples [N]")
    drift: Number = Field(description="by which that grows [N/s]")
    cycles: Count = Field(description="of the motion that can be fitted by themselves")
    budget: list[BudgetDocument] = Field(description="sources of uncertainty of the unknowns")
    rms: Number = Field(description="root mean square of the residuals [N]")


class ComparisonDocument(Document):
    """Measures by which the tracks of one record are compared."""

    prediction: Number = Field(description="rms error of the predicted force as a part of the rms of the force")
    prediction_rms: Number = Field(
        description="rms of the model's force at the measured motion, with the estimates of the sample before, less "
        "the measured force [N]; from 1 s of contact on"
    )
    force_rms: Number = Field(description="rms of the measured contact force at the same samples [N]")
    predicted: Count = Field(description="samples that have a prediction")
    predictable: Count = Field(description="samples that any estimator could have predicted")
    nis_band: Annotated[list[Number], Field(min_length=2, max_length=2)] = Field(
        description="in which 95 % of the means lie where model and noise are right"
    )
    settling_times: dict[str, Number] = Field(
        description="time of contact until a parameter stays within 5 % of its end [s], by name"
    )
    distances: dict[str, Number] = Field(description="value less truth in combined uncertainties, by name")


class TrackDocument(Document):
    """Results of one track."""

    model: str = Field(description="name of its contact model")
    estimator: str = Field(description="name of its estimator")
    verdict: str = Field(
        pattern=VERDICT,
        description="that of its elasticity, without one the worst of its values with a number; numbers of an invalid "
        "track must not be used",
    )
    samples: Count = Field(description="that it tracked")
    parameters: dict[str, ValueDocument] = Field(description="of the contact model, by name")
    derived: dict[str, DerivedValueDocument] = Field(
        description="elasticity or viscosity that follows from parameters that are something else, by name"
    )
    surface: ValueDocument = Field(description="height of the undeformed surface")
    force_rms: Number = Field(description="root mean square of measured force less inertia less the model's force [N]")
    nis: Number = Field(
        description="normalised innovation squared, mean over the end; 1 where model and noise are right"
    )
    budget: list[BudgetDocument] = Field(description="every source of uncertainty with its effect on each parameter")
    flags: list[FlagDocument] = Field(description="what counts against it; those of the record come first")
    conditions: list[ConditionDocument] = Field([], description="open facts: what the values hold for")
    immaterial: list[FlagDocument] = Field(
        [], description="flags that can move no value beyond its uncertainty, and are not a doubt"
    )
    seconds_per_sample: float = Field(description="of computing [s]")
    comparison: ComparisonDocument | Absent = Field(None, description="of a run with several tracks")
    fit: FitDocument | Absent = Field(None, description="of an offline fit")
    details: Open = Field({}, description="what the estimator says beyond its numbers; each fills it as it likes")
    diagnoses: dict[str, Open] = Field({}, description="what diagnoses say, by name; each fills its own as it likes")

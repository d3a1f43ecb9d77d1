"""The steps of a guided calibration: what each makes of its records."""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate import LogError

from palpate_calibration.calibrated_value import MeasuredValue, RepeatValue
from palpate_calibration.calibration_record import CalibrationRecord
from palpate_calibration.motion_segments import (
    Segment,
    SteadyMotion,
    hesitation_note,
    longest_standstill,
    shake_segments,
)
from palpate_calibration.protocol import StepFindings, compliance_from_presses, delay_from_taps, refuse_broken, shaken
from palpate_calibration.settings import CalibrationSettings
from palpate_calibration.shake_analysis import against_average
from palpate_calibration.sines import find_lines, harmonics_of, sine_fit
from palpate_calibration.standstill import long_standstill_fit, spectra, standstill_values

_ENOUGH = 2.0  # [s] of standstill


def evaluate_step(step: str, records: Sequence[CalibrationRecord], settings: CalibrationSettings) -> StepFindings:
    """Results from the records of one step; raises LogError with the reason where they cannot be used."""
    if step == "standstill":
        return still(records, settings)
    if step == "shake":
        return shaken(records, settings)
    if step == "noise":
        return noisy(records, settings)
    return delay_from_taps(records) if step == "tap" else compliance_from_presses(records)


def still(records: Sequence[CalibrationRecord], settings: CalibrationSettings) -> StepFindings:
    """Offset, drift, noise and its spectrum from long standstills in free air."""
    segments: list[Segment] = []
    for record in records:
        refuse_broken(record)
        segment = longest_standstill(record)
        if segment is None or segment.length < _ENOUGH:
            raise LogError("calibration: the record contains no standstill of 2 s or more: the tip moves, or shakes")
        segments.append(segment)
    fits = [long_standstill_fit(record, segment) for record, segment in zip(records, segments, strict=True)]
    notes = []
    colour = max(item.colour for fit in fits for item in fit.stretches)
    if colour > 2.0:
        notes.append(
            f"coloured-noise: below a tenth of its rate the force noise is {colour:.1f} times that of white noise"
        )
    values = standstill_values(fits, settings.type_b.offset)
    return StepFindings(values, standstills=tuple(fits), notes=tuple(notes), spectra=spectra(records, segments))


def noisy(records: Sequence[CalibrationRecord], settings: CalibrationSettings) -> StepFindings:
    """Noise of the velocity while the tip moves: as the paper has it, and without what the motion adds to that.

    The paper's figure is the RMSE between the velocity and its 21-sample mean, which also contains what the mean cuts
    off the motion itself. The other one is the scatter about sines at the motion's own frequencies and their harmonics.
    """
    paper, moving = [], []
    for record in records:
        refuse_broken(record)
        if record.velocity is None:
            raise LogError("calibration: the noise of the velocity needs [alignment] velocity")
        segments = shake_segments(record, settings.settle)
        if not segments:
            raise LogError("calibration: the record contains no steady oscillation of 2 s or more")
        for segment in segments:
            planned = SteadyMotion.of(record, segment)
            if planned.breaks_up:
                raise LogError(
                    f"calibration: {hesitation_note(planned.count)}; that is over half of the motion, "
                    "and cannot be distinguished "
                    "from noise: keep other work from this computer"
                )
            times, speeds = record.velocity.between(segment.begin, segment.end)
            paper += [rmse for rmse in [against_average(speeds, planned.hold(times))] if rmse is not None]
            moving.append(_scatter(record, segment, planned))
    values = {"moving_velocity_std": MeasuredValue.of(moving, "m/s")}
    if paper:
        values["paper_velocity_std"] = MeasuredValue.of(paper, "m/s")
    return StepFindings(values)


def _scatter(record: CalibrationRecord, segment: Segment, planned: SteadyMotion) -> RepeatValue:
    assert record.velocity is not None
    instants, heights = record.position.between(segment.begin, segment.end)
    lines = find_lines(instants, heights, planned.hold(instants))
    every = (*lines, *harmonics_of(lines, record.position.rate / 2.5, segment.length))
    times, speeds = record.velocity.between(segment.begin, segment.end)
    residual = sine_fit(times, speeds, every, (segment.begin + segment.end) / 2, planned.hold(times)).residual
    freedom = len(residual) - 2.0 - 2 * len(every)
    std = math.sqrt(float((residual**2).sum()) / freedom)
    return RepeatValue(std, std / math.sqrt(2 * freedom), freedom)

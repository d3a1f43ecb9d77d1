"""The steps of a guided calibration: the results of each, from its records."""

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
from palpate_calibration.protocol import (
    MAX_COLOUR,
    StepFindings,
    compliance_from_presses,
    delay_from_taps,
    refuse_broken,
    shake_findings,
)
from palpate_calibration.settings import CalibrationSettings
from palpate_calibration.shake_analysis import against_average
from palpate_calibration.sines import find_lines, harmonics_of, sine_fit
from palpate_calibration.standstill import long_standstill_fit, spectra, standstill_values

_MIN_STANDSTILL = 2.0  # [s]: a choice
_SAMPLES_PER_PERIOD = 2.5  # at least, of a harmonic that is looked at: a choice


def evaluate_step(step: str, records: Sequence[CalibrationRecord], settings: CalibrationSettings) -> StepFindings:
    """Return the results from the records of one step; raises LogError with the reason where they cannot be used."""
    if step == "standstill":
        return standstill_findings(records, settings)
    if step == "shake":
        return shake_findings(records, settings)
    if step == "noise":
        return noise_findings(records, settings)
    return delay_from_taps(records) if step == "tap" else compliance_from_presses(records)


def standstill_findings(records: Sequence[CalibrationRecord], settings: CalibrationSettings) -> StepFindings:
    """Return offset, drift, noise and its spectrum from long standstills in free air, one of each record."""
    segments: list[Segment] = []
    for record in records:
        refuse_broken(record)
        segment = longest_standstill(record)
        if segment is None or segment.length < _MIN_STANDSTILL:
            raise LogError("calibration: the record contains no standstill of 2 s or more: the tip moves, or shakes")
        segments.append(segment)
    fits = [long_standstill_fit(record, segment) for record, segment in zip(records, segments, strict=True)]
    # The density of the slow noise over that of white noise, of the worst stretch.
    notes = []
    colour = max(stretch.colour for fit in fits for stretch in fit.stretches)
    if colour > MAX_COLOUR:
        notes.append(
            f"coloured-noise: below a tenth of its rate the force noise is {colour:.1f} times that of white noise"
        )
    values = standstill_values(fits, settings.type_b.offset)
    return StepFindings(values, standstills=tuple(fits), notes=tuple(notes), spectra=spectra(records, segments))


def noise_findings(records: Sequence[CalibrationRecord], settings: CalibrationSettings) -> StepFindings:
    """Return the noise of the velocity while the tip moves: as the paper has it, and without what the motion adds.

    The paper's figure is the RMSE between the velocity and its 21-sample mean, which also contains what the mean cuts
    off the motion itself. The other one is the scatter about sines at the motion's own frequencies and their harmonics.
    """
    paper_stds, stds = [], []
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
                    f"calibration: {hesitation_note(planned.count)}; that is over half of the motion, and cannot be "
                    "distinguished from noise: keep other work from this computer"
                )
            times, speeds = record.velocity.between(segment.begin, segment.end)
            paper_std = against_average(speeds, planned.hold(times))
            if paper_std is not None:
                paper_stds.append(paper_std)
            stds.append(_velocity_noise(record, segment, planned))
    values = {"moving_velocity_std": MeasuredValue.of(stds, "m/s")}
    if paper_stds:
        values["paper_velocity_std"] = MeasuredValue.of(paper_stds, "m/s")
    return StepFindings(values)


def _velocity_noise(record: CalibrationRecord, segment: Segment, planned: SteadyMotion) -> RepeatValue:
    """Return the scatter [m/s] of the velocity about the lines of the motion and their harmonics."""
    assert record.velocity is not None
    instants, heights = record.position.between(segment.begin, segment.end)
    lines = find_lines(instants, heights, planned.hold(instants))
    frequencies = (*lines, *harmonics_of(lines, record.position.rate / _SAMPLES_PER_PERIOD, segment.length))
    times, speeds = record.velocity.between(segment.begin, segment.end)
    middle = (segment.begin + segment.end) / 2
    residual = sine_fit(times, speeds, frequencies, middle, planned.hold(times)).residual
    freedom = len(residual) - 2.0 - 2 * len(frequencies)
    std = math.sqrt(float((residual**2).sum()) / freedom)
    return RepeatValue(std, std / math.sqrt(2 * freedom), freedom)

"""Motions whose frequency changes, a chirp or steps: pieces of a few cycles, each a sine of its own."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from palpate import Floats

from palpate_spectra.spectral_lines import MIN_EXPLAINED_SHARE, LineFit, Phasors

# Choices.
_CYCLES = 4  # of a piece: enough to distinguish its frequency from a trend, few enough that a chirp hardly changes
_MIN_SAMPLES = 60  # of a piece
_MAX_HARMONIC = 3  # of the piece's sine that the fit has, so that a nonlinear force is not taken as noise
_GAUSS_NEWTON_STEPS = 6
_SAME_STEP_SHARE = 0.03  # pieces one after another whose durations differ by less are one step of the frequency
_MIN_DURATION = 1e-12  # [s] keeps a division by a duration finite


def fit_pieces(time: Floats, channels: Floats, motion_column: int) -> tuple[list[LineFit], Floats]:
    """Return the fits of channels (n, c) on the pieces of a motion, and the pieces' chirp rates (pieces,) [Hz/s].

    `motion_column` is the column of the motion in the channels. A piece has four cycles of the motion's phase, which
    is that of the analytic signal; pieces of one frequency are joined. Those in which the motion is not a sine with a
    linearly changing frequency (a step of the frequency, the ends) are left out.
    """
    phase = _analytic_phase(time, channels[:, motion_column])
    fits, chirp_rates = [], []
    for first, end in _pieces(time, phase):
        if end - first < _MIN_SAMPLES:
            continue
        piece = _fit_piece(time[first:end], channels[first:end], motion_column, phase[first:end])
        if piece is not None:
            fit, chirp_rate = piece
            fits.append(fit)
            chirp_rates.append(chirp_rate)
    return fits, np.array(chirp_rates)


def _analytic_phase(time: Floats, motion: Floats) -> Floats:
    """Return the phase (n,) [rad] of a motion (n,) about its straight trend, by Hilbert's transform."""
    from scipy.signal import hilbert

    trend = np.column_stack([np.ones_like(time), time - time.mean()])
    oscillation = motion - trend @ np.linalg.lstsq(trend, motion, rcond=None)[0]
    return np.asarray(np.unwrap(np.angle(np.asarray(hilbert(oscillation)))))


def _pieces(time: Floats, phase: Floats) -> list[tuple[int, int]]:
    """Return the pieces of four cycles of a phase (n,) [rad], as first row and the row after the last."""
    cycles = (phase - phase[0]) / (2 * np.pi)
    count = int(cycles[-1] // _CYCLES)
    edges = np.searchsorted(np.maximum.accumulate(cycles), _CYCLES * np.arange(count + 1))
    return _join_equal_pieces(edges.tolist(), time)


def _join_equal_pieces(edges: Sequence[int], time: Floats) -> list[tuple[int, int]]:
    """Return the pieces (first row, row after the last) between edges; neighbours that last equally long are one."""
    pieces: list[tuple[int, int]] = []
    step_duration = 0.0  # [s] of the first piece of the current step
    for first, end in pairwise(edges):
        duration = float(time[min(end, len(time) - 1)] - time[first])
        if pieces and abs(duration / step_duration - 1.0) < _SAME_STEP_SHARE:
            pieces[-1] = (pieces[-1][0], end)
            continue
        pieces.append((first, end))
        step_duration = max(duration, _MIN_DURATION)
    return pieces


def _fit_piece(time: Floats, channels: Floats, motion_column: int, phase: Floats) -> tuple[LineFit, float] | None:
    """Return the phasors of a piece at its middle, and its chirp rate [Hz/s]; None where its motion is not a sine.

    `phase` (n,) [rad] is the first guess of the sine's.
    """
    middle = float((time[0] + time[-1]) / 2)
    t = time - middle
    motion = channels[:, motion_column]
    omega, curvature = _refine_phase(t, motion, phase)
    if not omega > 0:
        return None

    design = _design_matrix(t, omega, curvature)
    coefficients = np.linalg.lstsq(design, channels, rcond=None)[0]
    residuals = channels - design @ coefficients
    trend = design[:, :2] @ np.linalg.lstsq(design[:, :2], motion, rcond=None)[0]
    residual_power = float(residuals[:, motion_column] @ residuals[:, motion_column])
    power = float((motion - trend) @ (motion - trend))
    if residual_power > (1 - MIN_EXPLAINED_SHARE) * power:
        return None

    covariance, freedom = _noise_covariance(residuals, parameters=design.shape[1])
    phasor = (coefficients[2] - 1j * coefficients[3])[None]  # a - i b of a cos + b sin
    fit = LineFit(
        frequencies=np.array([omega / (2 * np.pi)]),
        phasors=phasor,
        covariances=covariance[None],
        freedom=np.array([freedom]),
        channel_means=channels.mean(axis=0),
    )
    # The frequency is d(phase)/dt over 2 pi, so that its rate is 2 c over 2 pi.
    return fit, float(curvature / np.pi)


def _refine_phase(t: Floats, motion: Floats, phase: Floats) -> tuple[float, float]:
    """Return w [rad/s] and c [rad/s^2] of the phase w t + c t^2 that describes a motion (n,) best.

    Gauss and Newton from the parabola through a first guess of the phase (n,) [rad]. Of a cos(phase) + b sin(phase) the
    derivatives by w and c are t and t^2 times b cos(phase) - a sin(phase).
    """
    curvature, omega, _ = np.polyfit(t, phase, 2)
    for _ in range(_GAUSS_NEWTON_STEPS):
        design = _design_matrix(t, omega, curvature)
        coefficients = np.linalg.lstsq(design, motion, rcond=None)[0]  # offset, slope, a, b, harmonics
        cosine, sine = np.cos(omega * t + curvature * t**2), np.sin(omega * t + curvature * t**2)
        by_phase = coefficients[3] * cosine - coefficients[2] * sine
        jacobian = np.column_stack([design, by_phase * t, by_phase * t**2])
        step = np.linalg.lstsq(jacobian, motion - design @ coefficients, rcond=None)[0][-2:]
        omega, curvature = omega + step[0], curvature + step[1]
    return omega, curvature


def _design_matrix(t: Floats, omega: float, curvature: float) -> Floats:
    """Return offset, slope, and the cosines and sines of the phase w t + c t^2 and its harmonics: (n, 2 + 2 * 3)."""
    columns = [np.ones_like(t), t]
    for harmonic in range(1, _MAX_HARMONIC + 1):
        phase = harmonic * (omega * t + curvature * t**2)
        columns += [np.cos(phase), np.sin(phase)]
    return np.column_stack(columns)


def _noise_covariance(residuals: Floats, parameters: int) -> tuple[Phasors, float]:
    """Return the covariance (c, c) of a piece's phasors, and its degrees of freedom.

    By the lower half of the spectrum S (m, c) of the residuals (n, c): the sum of S S^H over the bins that the fit's
    `parameters` leave, times (2/n)^2, since the phasor of a sine in n samples is 2/n of its line in S. Each bin has two
    quadratures, and so two degrees of freedom.
    """
    n = len(residuals)
    # n // 2 bins reach the Nyquist frequency; bin 0 is the mean.
    spectrum = np.fft.rfft(residuals, axis=0)[1 : max(n // 4, 2)]
    bins = max(len(spectrum) - parameters / 2, 1.0)
    return np.asarray(4.0 / n**2 * (spectrum.T @ spectrum.conj()) / bins, np.complex128), 2.0 * bins

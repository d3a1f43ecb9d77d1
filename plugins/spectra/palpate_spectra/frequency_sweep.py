"""Motions whose frequency changes, a chirp or steps: pieces of a few cycles, each a sine of its own."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from palpate import Floats

from palpate_spectra.spectral_lines import LineFit, Phasors

_CYCLES = 4  # of a piece
_FEWEST = 60  # samples of a piece
_EXPLAINED = 0.98  # of the motion's power in a piece; less is not a sine
_HARMONICS = 3
_ROUNDS = 6
_NEAR = 0.03  # of a frequency; pieces nearer than that, one after another, are one step


def pieces(time: Floats, channels: Floats, height: int) -> tuple[list[LineFit], Floats]:
    """Fits of pieces of a motion, and their frequencies' rate of change (pieces,) [Hz/s].

    `height` is the number of the motion's channel. Its phase is that of the analytic signal; within a piece it is a
    parabola that least squares finds. Pieces in which the motion is not such a sine (a step of the frequency, the ends)
    are left out; those of one frequency are one.
    """
    from scipy.signal import hilbert

    motion = channels[:, height]
    smooth = np.column_stack([np.ones_like(time), time - time.mean()])
    left = motion - smooth @ np.linalg.lstsq(smooth, motion, rcond=None)[0]
    phase = np.unwrap(np.angle(np.asarray(hilbert(left))))
    cycles = (phase - phase[0]) / (2 * np.pi)
    whole = int(cycles[-1] // _CYCLES)
    edges = np.searchsorted(np.maximum.accumulate(cycles), _CYCLES * np.arange(whole + 1))
    fits, rates = [], []
    for begin, end in _joined(edges.tolist(), time):
        if end - begin < _FEWEST:
            continue
        found = _piece(time[begin:end], channels[begin:end], height, phase[begin:end])
        if found is not None:
            fits.append(found[0])
            rates.append(found[1])
    return fits, np.array(rates)


def _joined(edges: Sequence[int], time: Floats) -> list[tuple[int, int]]:
    """Pieces (begin, end) between edges; those one after another that last equally long are one."""
    found: list[tuple[int, int]] = []
    mean = 0.0
    for begin, end in pairwise(edges):
        length = float(time[min(end, len(time) - 1)] - time[begin])
        if found and found[-1][1] == begin and abs(length / mean - 1.0) < _NEAR:
            found[-1] = (found[-1][0], end)
            continue
        found.append((begin, end))
        mean = max(length, 1e-12)
    return found


def _piece(time: Floats, channels: Floats, height: int, phase: Floats) -> tuple[LineFit, float] | None:
    """Phasors of a piece at its middle, and the rate of change of its frequency [Hz/s]; None where it is not a sine."""
    middle = float((time[0] + time[-1]) / 2)
    t = time - middle
    bend, omega, _ = np.polyfit(t, phase, 2)
    motion = channels[:, height]
    for _ in range(_ROUNDS):
        design = _design(t, omega, bend)
        found = np.linalg.lstsq(design, motion, rcond=None)[0]
        turned = found[3] * np.cos(omega * t + bend * t**2) - found[2] * np.sin(omega * t + bend * t**2)
        both = np.column_stack([design, turned * t, turned * t**2])
        step = np.linalg.lstsq(both, motion - design @ found, rcond=None)[0][-2:]
        omega, bend = omega + step[0], bend + step[1]
    if not omega > 0:
        return None
    design = _design(t, omega, bend)
    found = np.linalg.lstsq(design, channels, rcond=None)[0]
    left = channels - design @ found
    trend = design[:, :2] @ np.linalg.lstsq(design[:, :2], motion, rcond=None)[0]
    if float(left[:, height] @ left[:, height]) > (1 - _EXPLAINED) * float((motion - trend) @ (motion - trend)):
        return None
    covariance, freedom = _noise(left, design.shape[1])
    phasor = (found[2] - 1j * found[3])[None]
    level = channels.mean(axis=0)
    fit = LineFit(np.array([omega / (2 * np.pi)]), phasor, covariance[None], np.array([freedom]), level)
    return fit, float(bend / np.pi)


def _design(t: Floats, omega: float, bend: float) -> Floats:
    """Offset, slope, and a sine whose frequency grows, with its harmonics (n, 2 + 2 * 3)."""
    columns = [np.ones_like(t), t]
    for k in range(1, _HARMONICS + 1):
        phase = k * (omega * t + bend * t**2)
        columns += [np.cos(phase), np.sin(phase)]
    return np.column_stack(columns)


def _noise(left: Floats, parameters: int) -> tuple[Phasors, float]:
    """Covariance (c, c) of phasors by the lower half of the residual's spectrum, and its degrees of freedom."""
    n = len(left)
    spectrum = np.fft.rfft(left, axis=0)[1 : max(n // 4, 2)]
    rows = max(len(spectrum) - parameters / 2, 1.0)
    return np.asarray(4.0 / n**2 * (spectrum.T @ spectrum.conj()) / rows, np.complex128), 2.0 * rows

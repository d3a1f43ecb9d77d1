"""Forty ways in which a record is wrong and shows it, each with one size; written down before the first run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from verdict_records.changes import (
    Change,
    base_way,
    bonded_layer,
    frozen,
    high_pass,
    low_pass,
    memory,
    part_of,
    play,
    since,
    smooth_rise,
    spikes,
    step_at,
)


@dataclass(frozen=True)
class Wrong:
    """One kind: `place` is what it changes, `most` the largest size that a laboratory would have."""

    name: str
    place: str  # depth, elastic, contact, reading, height, or cut
    change: Change
    most: float
    causes: tuple[str, ...]  # of which one is among the words of the finding
    rigs: tuple[str, ...]


_ALL = ("press", "robot", "robot-ramp", "texture")
_SHAPE = ("exponent", "tip", "thickness", "layer", "shape", "stiffen", "strain", "depth")
_MEMORY = ("memory", "relax", "power law", "two times", "poro", "unloading", "law")
_ZERO = ("zero", "tare", "drift", "air", "offset")
_BASE = ("compliance", "gives way", "series", "mount", "base", "thickness")

WRONGS = tuple(
    Wrong(*row)
    for row in (
        ("another exponent", "elastic", lambda s, x, d, f: f * np.maximum(part_of(s, d), 1e-9) ** x, 1.5, _SHAPE, _ALL),
        (
            "a lower exponent",
            "elastic",
            lambda s, x, d, f: f * np.maximum(part_of(s, d), 1e-9) ** -x,
            0.6,
            _SHAPE,
            ("press", "robot", "robot-ramp", "cone"),
        ),
        ("a bonded layer", "elastic", bonded_layer, 1.5, _SHAPE, ("press", "robot", "robot-ramp", "instron")),
        ("stiffening with depth", "elastic", lambda s, x, d, f: f * (1 + x * part_of(s, d)), 5.0, _SHAPE, _ALL),
        ("softening with depth", "elastic", lambda s, x, d, f: f * (1 - x * part_of(s, d)), 0.6, _SHAPE, _ALL),
        ("a soft skin", "elastic", lambda s, x, d, f: f * (1 - x * np.exp(-5 * part_of(s, d))), 0.95, _SHAPE, _ALL),
        (
            "a hard lump below",
            "elastic",
            lambda s, x, d, f: f * (1 + x * np.exp(8 * (part_of(s, d) - 1))),
            3.0,
            _SHAPE,
            _ALL,
        ),
        ("relaxing in 0.03 s", "elastic", memory(0.03), 2.0, _MEMORY, ("robot-ramp", "texture", "cone")),
        ("relaxing in 0.3 s", "elastic", memory(0.3), 2.0, _MEMORY, ("press", "robot", "robot-ramp", "texture")),
        ("relaxing in 3 s", "elastic", memory(3.0), 2.0, _MEMORY, ("press", "robot", "instron", "beam")),
        (
            "a power law",
            "elastic",
            memory(0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0),
            3.0,
            _MEMORY,
            ("press", "robot", "texture", "afm"),
        ),
        (
            "weaker on the way back",
            "elastic",
            lambda s, x, d, f: f * (1 - x * (s.rate_of(d) < -1e-9)),
            0.5,
            (*_MEMORY, "hysteresis", "pull", "slip", "play"),
            ("texture", "instron", "robot-ramp", "afm"),
        ),
        (
            "15 % go under load",
            "elastic",
            lambda s, x, d, f: f * (1 + x * np.expm1(-since(s, d) / 2)),
            0.6,
            ("memory", "relax", "drift", "steady", "chang", "aging", "soften"),
            ("press", "robot", "robot-ramp", "instron"),
        ),
        (
            "drying",
            "elastic",
            lambda s, x, d, f: f * (1 + x * since(s, d) / max(since(s, d)[-1], 1e-9)),
            1.0,
            ("drift", "memory", "relax", "steady", "chang", "stiff", "thickness"),
            ("press", "robot", "texture", "instron"),
        ),
        (
            "a pull in contact",
            "contact",
            lambda s, x, d, f: np.where(d > 0, f - x, f),
            1e3,
            ("pull", "adhes", *_ZERO, "tip", "exponent"),
            ("texture", "robot-ramp", "press", "afm"),
        ),
        (
            "a wet tip",
            "contact",
            lambda s, x, d, f: f - x * ((np.maximum.accumulate(d) > 0) & (d > -0.15 * np.max(d))),
            1e3,
            ("pull", "adhes", *_ZERO, "tip"),
            ("texture", "robot-ramp", "instron"),
        ),
        (
            "a set on the way back",
            "depth",
            lambda s, x, d, f: d - x * np.maximum.accumulate(np.maximum(d, 0)) * (s.rate_of(d) < 0),
            0.3,
            (*_MEMORY, "hysteresis", "slip", "play", "surface", "touch", "moved"),
            ("texture", "instron", "robot-ramp"),
        ),
        (
            "the specimen sinks",
            "depth",
            lambda s, x, d, f: d + x * np.max(d) * np.expm1(-since(s, d) / 3),
            0.5,
            ("drift", "memory", "relax", "surface", "moved", "slip", "creep"),
            ("press", "robot", "instron", "texture"),
        ),
        (
            "the specimen slips",
            "depth",
            lambda s, x, d, f: d - np.max(d) * step_at(s, x, d),
            0.4,
            ("slip", "surface", "moved", "drift", "memory", "step"),
            ("press", "robot", "robot-ramp", "instron"),
        ),
        (
            "breathing at 0.25 Hz",
            "depth",
            lambda s, x, d, f: d + x * np.max(d) * np.sin(np.pi / 2 * s.time) * (d > 0),
            0.4,
            ("breath", "surface", "moved", "drift", "memory", "hz", "slow"),
            ("press", "robot", "texture"),
        ),
        (
            "a base that gives",
            "depth",
            base_way,
            1.0,
            (*_BASE, "tip", "exponent"),
            ("press", "robot", "robot-ramp", "cone"),
        ),
        (
            "3 mm sideways at 30 degrees",
            "depth",
            lambda s, x, d, f: d - x * np.max(d) * smooth_rise(s, d),
            0.9,
            ("sideways", "surface", "moved", "slip", "drift", "memory", "tilt"),
            ("press", "robot", "robot-ramp"),
        ),
        (
            "play of the arm",
            "height",
            lambda s, x, d, f: play(x * np.max(d), d),
            0.2,
            ("play", "backlash", "timing", "late", "delay", "hysteresis", "memory", "unloading"),
            ("texture", "robot", "robot-ramp"),
        ),
        (
            "an error of the encoder",
            "height",
            lambda s, x, d, f: d + x * np.max(d) * np.sin(27.3 * d / np.max(d)),
            0.2,
            ("encoder", "position", "periodic", "depth"),
            _ALL,
        ),
        (
            "a bent force",
            "reading",
            lambda s, x, d, f: f * (1 + x * f / np.max(np.abs(f))),
            0.5,
            (*_SHAPE, "force", "linear"),
            _ALL,
        ),
        (
            "the zero steps",
            "reading",
            lambda s, x, d, f: f + step_at(s, x, d),
            1e3,
            (*_ZERO, "step"),
            ("press", "robot", "texture", "instron"),
        ),
        (
            "the zero drifts",
            "reading",
            lambda s, x, d, f: f + x * s.time / s.time[-1],
            1e3,
            _ZERO,
            ("press", "robot", "texture", "instron"),
        ),
        (
            "the sensor warms up",
            "reading",
            lambda s, x, d, f: f - x * np.expm1(-s.time / 5),
            1e3,
            _ZERO,
            ("robot", "texture", "instron"),
        ),
        (
            "an AC-coupled force",
            "reading",
            high_pass,
            0.5,
            (*_ZERO, "ac", "memory", "relax", "coupled"),
            ("press", "robot", "texture"),
        ),
        (
            "a slow alias",
            "reading",
            lambda s, x, d, f: f + x * np.sin(2 * np.pi * 0.37 * s.time + 1),
            1e3,
            ("hz", "sine", "hum", "alias", *_ZERO, "period"),
            ("press", "robot", "texture", "instron"),
        ),
        (
            "friction in a guide",
            "reading",
            lambda s, x, d, f: f + x * np.tanh(50 * s.rate_of(d) / np.max(np.abs(s.rate_of(d)))),
            1e3,
            ("friction", "air", "hysteresis", "speed", "memory", "timing", "drag"),
            ("robot", "robot-ramp", "texture"),
        ),
        (
            "a cable",
            "reading",
            lambda s, x, d, f: f + x * (d - d[0]) / (np.max(d) - d[0]),
            1e3,
            ("air", "height", "cable", *_ZERO),
            ("robot", "robot-ramp", "texture", "press"),
        ),
        (
            "drag in a liquid",
            "reading",
            lambda s, x, d, f: f + x * s.rate_of(d) / np.max(np.abs(s.rate_of(d))),
            1e3,
            ("air", "speed", "drag", "timing"),
            ("robot", "robot-ramp", "texture"),
        ),
        (
            "saturated",
            "reading",
            lambda s, x, d, f: np.minimum(f, (1 - x) * np.max(f)),
            0.7,
            ("saturat", "limit", "stuck", "range", "steady"),
            _ALL,
        ),
        (
            "the force stands still",
            "reading",
            frozen,
            0.8,
            ("stuck", "repeat", "still", "equal"),
            ("press", "robot", "texture", "instron"),
        ),
        (
            "another mass",
            "reading",
            lambda s, x, d, f: f + x * s.rate_of(s.rate_of(d)),
            2.0,
            ("mass", "inertia"),
            ("robot-speed",),
        ),
        (
            "the log is the command",
            "height",
            lambda s, x, d, f: low_pass(s, d[::-1], x)[::-1],
            0.05,
            ("command", "delay", "timing", "late"),
            ("robot-ramp", "robot", "texture"),
        ),
        (
            "stage and deflection",
            "height",
            lambda s, x, d, f: d + x * np.max(d) / np.max(f) * f,
            2.0,
            ("stage", "deflection", *_BASE),
            ("beam", "afm"),
        ),
        ("single readings off", "reading", spikes, 1e3, ("outlier", "single", "spike"), _ALL),
        (
            "zeroed in contact",
            "cut",
            lambda s, x, d, f: d,
            0.8,
            (*_ZERO, "contact", "tip", "exponent"),
            ("texture", "robot-ramp", "instron", "press"),
        ),
    )
)

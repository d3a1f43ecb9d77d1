"""Documents of results for tests that need one without a run."""

from palpate_engine.result import SCHEMA


def value(number, unit="Pa", std=1.0, **more):
    """A value with its uncertainty, as in ``result.json``."""
    return {"value": number, "std": std, "unit": unit, "settling": 0.0, "combined": std, **more}


def track(verdict="good", flags=(), **more):
    """A track, as in ``result.json``."""
    return {
        "model": "dr",
        "estimator": "ekf",
        "verdict": verdict,
        "samples": 1000,
        "parameters": {"elasticity": value(1e5)},
        "derived": {},
        "surface": value(0.0, "m", 1e-6),
        "force_rms": 0.05,
        "nis": 1.0,
        "budget": [],
        "flags": list(flags),
        "seconds_per_sample": 1e-6,
        **more,
    }


def result(tracks, **more):
    """The contents of a ``result.json``."""
    run = {
        "name": "run",
        "pipeline": "run.toml",
        "command": ["palpate", "run", "run.toml"],
        "seed": 1,
        "versions": {"palpate": "0.2.0"},
        "plugins": [],
        "inputs": {},
        "host": "here",
        "started": "2026-01-01T00:00:00+00:00",
        "duration": 1.0,
        "samples": 1000,
        "log_duration": 2.0,
        "tare": None,
        "velocity_delay": None,
        "first_touch": None,
    }
    return {
        "schema": SCHEMA,
        "palpate": "0.2.0",
        "run": run,
        "streams": {},
        "truth": {},
        "tracks": tracks,
        **more,
    }

"""The Python interface for people with data: the one family that the core names, imported when it is first used."""

from palpate_notebook import compare, fit, fit_folder, load, open_run, prepare, read, record, run, sweep

__all__ = ["compare", "fit", "fit_folder", "load", "open_run", "prepare", "read", "record", "run", "sweep"]

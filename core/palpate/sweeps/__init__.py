"""Sweeps of settings: combinations as plain data, engines that run them, and their table."""

from palpate.sweeps.combinations import combinations_of
from palpate.sweeps.jobs import Engine, Job, built, finished, on_all_cores, run_job
from palpate.sweeps.table import rows_of, write_rows

__all__ = [
    "Engine",
    "Job",
    "built",
    "combinations_of",
    "finished",
    "on_all_cores",
    "rows_of",
    "run_job",
    "write_rows",
]

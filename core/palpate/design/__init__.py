"""Design: how well a palpation can tell its parameters at best, before anything moves."""

from palpate.design.bounds import Bound, Nuisances, cramer_rao
from palpate.design.palpation import Case, Palpation, best, palpations
from palpate.design.path import Path, sine_path
from palpate.design.settings import DesignSettings, Loop
from palpate.design.slopes import force_slopes

__all__ = [
    "Bound",
    "Case",
    "DesignSettings",
    "Loop",
    "Nuisances",
    "Palpation",
    "Path",
    "best",
    "cramer_rao",
    "force_slopes",
    "palpations",
    "sine_path",
]

"""Offline fits of contact models to recorded palpations, with the surface unknown.

`estimator` holds the settings, `tracker` leads through a fit: `segments` and `motion` make a `residual` of the record,
`first_guess` and `solvers` find its minimum, `uncertainty`, `profile`, `bootstrap` and `budget` say how far it can be
believed, `identifiability` what cannot be told apart, `contact_point` where other methods see the surface, `report`
and `summary` what of all this goes into the result, `meanings` what its flags mean.
"""

from palpate_filters.fit.estimator import CasadiFit
from palpate_filters.fit.meanings import FIT_FLAGS

__all__ = ["FIT_FLAGS", "CasadiFit"]

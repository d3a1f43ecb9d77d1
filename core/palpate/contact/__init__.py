"""Contact: tips and contact models, from depth to force."""

from palpate.contact.expressions import arctan, log, select, sqrt, tanh
from palpate.contact.force_history import force_over_time
from palpate.contact.interfaces import ContactModel, Indenter, MaterialValue, Parameter, contact_force
from palpate.contact.loading_cycle import LoadingCycle, loading_cycle_force
from palpate.contact.sensitivity import force_slopes
from palpate.contact.state_step import advance_states
from palpate.contact.tip_shape import tip_profile

__all__ = [
    "ContactModel",
    "Indenter",
    "LoadingCycle",
    "MaterialValue",
    "Parameter",
    "advance_states",
    "arctan",
    "contact_force",
    "force_over_time",
    "force_slopes",
    "loading_cycle_force",
    "log",
    "select",
    "sqrt",
    "tanh",
    "tip_profile",
]

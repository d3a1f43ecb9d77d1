"""Contact: tips and contact models, from depth to force."""

from palpate.contact.expressions import arctan, log, select, sqrt, tanh
from palpate.contact.history import force_over_time
from palpate.contact.interfaces import ContactModel, Indenter, MaterialValue, Parameter, contact_force
from palpate.contact.shape import tip_profile
from palpate.contact.slopes import force_slopes

__all__ = [
    "ContactModel",
    "Indenter",
    "MaterialValue",
    "Parameter",
    "arctan",
    "contact_force",
    "force_over_time",
    "force_slopes",
    "log",
    "select",
    "sqrt",
    "tanh",
    "tip_profile",
]

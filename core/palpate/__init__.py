"""palpate: elasticity and viscosity of soft material from robotic palpation, each with its uncertainty."""

from palpate.contact import ContactModel, Indenter, Parameter, contact_force
from palpate.device import Arm, Batch, Channel, Device, Link, Retractable, Stream, Watched
from palpate.errors import ConfigurationError, DeviceError, LogError, OutputError, PalpateError, PluginError, UserError
from palpate.estimation import (
    Belief,
    Estimates,
    Estimator,
    Moment,
    Problem,
    Samples,
    Status,
    Tracker,
    track_by_step,
)
from palpate.hooks import plugin
from palpate.kernel import Kernel, Step, compile_step
from palpate.parts import File, Part, Settings
from palpate.process import InertialProcess
from palpate.sink import Run, Sink, Writer
from palpate.trajectory import Setpoint, Trajectory
from palpate.twin import Twin
from palpate.units import (
    Acceleration,
    Angle,
    Damping,
    Force,
    ForceDrift,
    Frequency,
    Length,
    Mass,
    Pressure,
    Speed,
    Stiffness,
    Time,
    Viscosity,
    to_si,
)

__all__ = [
    "Acceleration",
    "Angle",
    "Arm",
    "Batch",
    "Belief",
    "Channel",
    "ConfigurationError",
    "ContactModel",
    "Damping",
    "Device",
    "DeviceError",
    "Estimates",
    "Estimator",
    "File",
    "Force",
    "ForceDrift",
    "Frequency",
    "Indenter",
    "InertialProcess",
    "Kernel",
    "Length",
    "Link",
    "LogError",
    "Mass",
    "Moment",
    "OutputError",
    "PalpateError",
    "Parameter",
    "Part",
    "PluginError",
    "Pressure",
    "Problem",
    "Retractable",
    "Run",
    "Samples",
    "Setpoint",
    "Settings",
    "Sink",
    "Speed",
    "Status",
    "Step",
    "Stiffness",
    "Stream",
    "Time",
    "Tracker",
    "Trajectory",
    "Twin",
    "UserError",
    "Viscosity",
    "Watched",
    "Writer",
    "compile_step",
    "contact_force",
    "plugin",
    "to_si",
    "track_by_step",
]

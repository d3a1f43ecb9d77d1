"""palpate: elasticity and viscosity of soft material from robotic palpation, each with its uncertainty."""

# The one family that the core names: its face for people with data, imported when it is first used.
from palpate_notebook import (
    compare as compare,
    fit as fit,
    load as load,
    open_run as open_run,
    read as read,
    record as record,
    run as run,
    sweep as sweep,
)

from palpate.alignment.change_point import ChangePoint as ChangePoint, change_point as change_point
from palpate.clocks import Clock as Clock, Thread as Thread, clock as clock, use_clock as use_clock
from palpate.contact import (
    ContactModel as ContactModel,
    Indenter as Indenter,
    MaterialValue as MaterialValue,
    Parameter as Parameter,
    arctan as arctan,
    contact_force as contact_force,
    force_over_time as force_over_time,
    log as log,
    select as select,
    sqrt as sqrt,
    tanh as tanh,
    tip_profile as tip_profile,
)
from palpate.device import (
    Approaching as Approaching,
    Arm as Arm,
    Attending as Attending,
    Batch as Batch,
    Channel as Channel,
    Device as Device,
    Leadable as Leadable,
    Link as Link,
    Observable as Observable,
    Refusing as Refusing,
    Retractable as Retractable,
    SelfMoving as SelfMoving,
    Simulated as Simulated,
    Stream as Stream,
    Turnable as Turnable,
    Watched as Watched,
)
from palpate.errors import (
    ConfigurationError as ConfigurationError,
    DeviceError as DeviceError,
    LogError as LogError,
    OutputError as OutputError,
    PalpateError as PalpateError,
    PluginError as PluginError,
    UserError as UserError,
)
from palpate.estimation import (
    Belief as Belief,
    Estimates as Estimates,
    Estimator as Estimator,
    Moment as Moment,
    Problem as Problem,
    Samples as Samples,
    Status as Status,
    Tracker as Tracker,
    track_by_step as track_by_step,
)
from palpate.extensions import (
    CalibrationReader as CalibrationReader,
    Check as Check,
    Command as Command,
    Diagnosis as Diagnosis,
    Display as Display,
    Fact as Fact,
    Recorder as Recorder,
    Report as Report,
    ReportSection as ReportSection,
    Summary as Summary,
    Template as Template,
    lazily as lazily,
)
from palpate.fit_report import BudgetRow as BudgetRow, Effect as Effect, FitReport as FitReport, Unknown as Unknown
from palpate.flags import ADVICE as ADVICE, Flag as Flag, FlagMeaning as FlagMeaning
from palpate.hooks import plugin as plugin
from palpate.limiting import (
    ArmLimits as ArmLimits,
    ForceWatch as ForceWatch,
    Limited as Limited,
    Retreating as Retreating,
    Shareable as Shareable,
    SharedReadings as SharedReadings,
    Sharing as Sharing,
)
from palpate.migration import Migration as Migration
from palpate.parts import File as File, InputFile as InputFile, Part as Part, Settings as Settings
from palpate.printed import printable as printable
from palpate.repeats import RepeatCount as RepeatCount, Repeats as Repeats
from palpate.result.evidence import (
    Diagnosed as Diagnosed,
    Ending as Ending,
    Term as Term,
    TrackEvidence as TrackEvidence,
)
from palpate.result.found import Bias as Bias
from palpate.result.kept import Kept as Kept
from palpate.result.tail import Tail as Tail
from palpate.result.track_result import TrackSummary as TrackSummary
from palpate.simulated_clock import HoldUp as HoldUp, SimulatedClock as SimulatedClock, ThreadEnded as ThreadEnded
from palpate.sink import (
    EstimatesWriter as EstimatesWriter,
    GuardState as GuardState,
    Run as Run,
    Sink as Sink,
    TakesFlags as TakesFlags,
    TakesGuard as TakesGuard,
    TakesHealth as TakesHealth,
    TakesResult as TakesResult,
    Writer as Writer,
)
from palpate.track_name import TrackName as TrackName
from palpate.trajectory import (
    ForceLaw as ForceLaw,
    ForceLed as ForceLed,
    OwnMotion as OwnMotion,
    Resumable as Resumable,
    Setpoint as Setpoint,
    Trajectory as Trajectory,
)
from palpate.twin import ArmTruth as ArmTruth, SimulatedTwin as SimulatedTwin, Twin as Twin
from palpate.units import (
    Acceleration as Acceleration,
    Angle as Angle,
    AngularSpeed as AngularSpeed,
    Damping as Damping,
    Delay as Delay,
    Depth as Depth,
    Force as Force,
    ForceDrift as ForceDrift,
    ForceWalk as ForceWalk,
    Frequency as Frequency,
    Length as Length,
    Mass as Mass,
    Pressure as Pressure,
    Quantity as Quantity,
    Speed as Speed,
    Stiffness as Stiffness,
    Time as Time,
    TipMass as TipMass,
    Viscosity as Viscosity,
    is_number as is_number,
    to_si as to_si,
)
from palpate.vectors import Floats as Floats, Layout as Layout, finite_rows as finite_rows

"""palpate: elasticity and viscosity of soft material from robotic palpation, each with its uncertainty."""

from .arm_limits import (
    RETREAT as RETREAT,
    RETREAT_SPEED as RETREAT_SPEED,
    ArmLimits as ArmLimits,
    ForceWatch as ForceWatch,
    Shareable as Shareable,
    SharedReadings as SharedReadings,
    SupportsLimits as SupportsLimits,
    SupportsRetreat as SupportsRetreat,
    SupportsSharing as SupportsSharing,
    torque_fault as torque_fault,
)
from .clocks import (
    Clock as Clock,
    Thread as Thread,
    clock as clock,
    epoch_offset as epoch_offset,
    host_time_ns as host_time_ns,
    use_clock as use_clock,
)
from .contact import (
    ContactModel as ContactModel,
    Indenter as Indenter,
    MaterialValue as MaterialValue,
    Parameter as Parameter,
    arctan as arctan,
    contact_force as contact_force,
    force_over_time as force_over_time,
    loading_cycle_force as loading_cycle_force,
    log as log,
    select as select,
    sqrt as sqrt,
    tanh as tanh,
    tip_profile as tip_profile,
)
from .device import (
    Arm as Arm,
    Batch as Batch,
    Channel as Channel,
    Device as Device,
    KnowsGravity as KnowsGravity,
    KnowsTruth as KnowsTruth,
    Link as Link,
    Observable as Observable,
    ReportsHealth as ReportsHealth,
    ReportsStops as ReportsStops,
    Retractable as Retractable,
    SeparateReceiver as SeparateReceiver,
    StopModes as StopModes,
    Stream as Stream,
    SupportsApproach as SupportsApproach,
    SupportsForceControl as SupportsForceControl,
    SupportsOwnMotion as SupportsOwnMotion,
    SupportsReach as SupportsReach,
    Turnable as Turnable,
)
from .errors import (
    ConfigurationError as ConfigurationError,
    DeviceError as DeviceError,
    LogError as LogError,
    OutputError as OutputError,
    PalpateError as PalpateError,
    PluginError as PluginError,
    UnstoppedArmError as UnstoppedArmError,
    UserError as UserError,
    suggest as suggest,
)
from .estimation import (
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
from .evidence.condition import Condition as Condition
from .evidence.sample_store import SampleStore as SampleStore
from .evidence.track_evidence import (
    Diagnosed as Diagnosed,
    Term as Term,
    TrackEnd as TrackEnd,
    TrackEvidence as TrackEvidence,
)
from .evidence.track_tail import Tail as Tail
from .evidence.uncertain_value import Bias as Bias
from .fit_report import BudgetRow as BudgetRow, Effect as Effect, FitReport as FitReport, Unknown as Unknown
from .flags import Flag as Flag, FlagMeaning as FlagMeaning
from .hooks import plugin as plugin
from .interface import API as API
from .last_digit import LastDigit as LastDigit
from .notebook import (
    compare as compare,
    fit as fit,
    fit_folder as fit_folder,
    load as load,
    open_run as open_run,
    prepare as prepare,
    read as read,
    record as record,
    run as run,
    sweep as sweep,
)
from .offers import (
    CalibrationReader as CalibrationReader,
    Check as Check,
    Command as Command,
    ControlReader as ControlReader,
    Diagnosis as Diagnosis,
    Display as Display,
    Fact as Fact,
    FileSuggestion as FileSuggestion,
    Recorder as Recorder,
    Report as Report,
    ReportSection as ReportSection,
    Summary as Summary,
    Template as Template,
)
from .parts import File as File, InputFile as InputFile, Part as Part, Settings as Settings
from .printable_text import printable as printable
from .repeated_readings import RepeatCount as RepeatCount, Repeats as Repeats
from .rotation_vectors import (
    angular_velocities as angular_velocities,
    rotation_rows as rotation_rows,
    turned_axes as turned_axes,
)
from .sink import (
    EstimatesWriter as EstimatesWriter,
    Extent as Extent,
    GuardState as GuardState,
    Run as Run,
    Sink as Sink,
    TakesFlags as TakesFlags,
    TakesGuard as TakesGuard,
    TakesHealth as TakesHealth,
    TakesResult as TakesResult,
    Writer as Writer,
)
from .surface import Surface as Surface, SurfacePoints as SurfacePoints, surface_points as surface_points
from .trajectory import (
    ForceControlled as ForceControlled,
    ForceLaw as ForceLaw,
    OwnMotion as OwnMotion,
    Resumable as Resumable,
    Setpoint as Setpoint,
    SupportsSurface as SupportsSurface,
    Trajectory as Trajectory,
    duration_of as duration_of,
    setpoints_at as setpoints_at,
    surface_of as surface_of,
)
from .twin import (
    ArmTruth as ArmTruth,
    HoldUp as HoldUp,
    SimulatedTwin as SimulatedTwin,
    SupportsTwin as SupportsTwin,
    Twin as Twin,
)
from .units import (
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
    Inertia as Inertia,
    Length as Length,
    Mass as Mass,
    Pressure as Pressure,
    Quantity as Quantity,
    RotationalStiffness as RotationalStiffness,
    Speed as Speed,
    Stiffness as Stiffness,
    Time as Time,
    TipMass as TipMass,
    Torque as Torque,
    Viscosity as Viscosity,
    is_number as is_number,
    is_unit as is_unit,
    to_si as to_si,
)
from .vectors import Floats as Floats, Layout as Layout, finite_rows as finite_rows

"""The face for what uses pipelines: load one, run it, read its run folder, run an analysis of another plugin by name.

Parts need `palpate` only; commands and other tools use `palpate` and this.
"""

# What several families use, from the one that makes it.
from palpate_basics.continuation import continued as continued, recorded_pipeline as recorded_pipeline
from palpate_basics.keeping import KeptSamples as KeptSamples
from palpate_basics.options import (
    FolderOption as FolderOption,
    FormatOption as FormatOption,
    JsonOption as JsonOption,
    Overrides as Overrides,
    PluginFiles as PluginFiles,
    Points as Points,
    TrackOption as TrackOption,
)
from palpate_basics.plain import aside as aside, print_json as print_json
from palpate_basics.progress import progress as progress, progressed as progressed
from palpate_basics.quantities import measured as measured, rounded as rounded
from palpate_basics.reading import read_flags as read_flags, read_result as read_result, upgraded as upgraded
from palpate_basics.run_folder import (
    EstimatesTable as EstimatesTable,
    RunFolder as RunFolder,
    TrackTable as TrackTable,
    pipeline_among as pipeline_among,
)
from palpate_basics.table import Table as Table, console as console
from palpate_calibration.file import (
    CalibratedValue as CalibratedValue,
    Calibration as Calibration,
    NoiseSpectrum as NoiseSpectrum,
)
from palpate_devices.logs.draft import (
    pipeline_of as pipeline_of,
    recording_of as recording_of,
    suggestion_of as suggestion_of,
)
from palpate_devices.logs.replaying import (
    Carried as Carried,
    added_table as added_table,
    carried_by as carried_by,
    replay_source as replay_source,
    with_other_channels as with_other_channels,
)
from palpate_devices.recording import (
    Attached as Attached,
    FieldSurvey as FieldSurvey,
    Recording as Recording,
    Suggestion as Suggestion,
    Survey as Survey,
    TopicSurvey as TopicSurvey,
)
from palpate_filters.fit.contact_point import (
    CONTACT_METHODS as CONTACT_METHODS,
    Approach as Approach,
    ContactPoint as ContactPoint,
    contact_point as contact_point,
)
from palpate_filters.fit.holds import Hold as Hold, holds_of as holds_of
from palpate_filters.least_squares import (
    least_squares as least_squares,
    normal_by_differences as normal_by_differences,
)
from palpate_filters.local_cubic import cubic_weights as cubic_weights, local_cubic as local_cubic
from palpate_models.ting import ting_force as ting_force
from palpate_report.pictures import (
    FORMATS as FORMATS,
    WIDTHS as WIDTHS,
    common_limits as common_limits,
    figure_of as figure_of,
    legend_outside as legend_outside,
    quartiles as quartiles,
    save_figure as save_figure,
    style as style,
)
from palpate_studies.answers import keep as keep
from palpate_studies.cluster import on_cluster as on_cluster
from palpate_studies.cores import on_all_cores as on_all_cores
from palpate_studies.differing import differences as differences
from palpate_studies.engines import (
    SchedulerOption as SchedulerOption,
    StageOption as StageOption,
    demand_scheduler as demand_scheduler,
)
from palpate_studies.jobs import (
    Answer as Answer,
    Engine as Engine,
    Job as Job,
    Outcome as Outcome,
    Written as Written,
    found_before as found_before,
    unused as unused,
)
from palpate_uncertainty.sources import sources_of as sources_of

from palpate import registry as registry
from palpate.alignment import (
    GRAVITY as GRAVITY,
    Aligner as Aligner,
    AlignmentReport as AlignmentReport,
    AlignmentSettings as AlignmentSettings,
    Health as Health,
    Hesitations as Hesitations,
    Intake as Intake,
    Ports as Ports,
    Series as Series,
    Signal as Signal,
    hesitations as hesitations,
)
from palpate.config import (
    CalibratedNumber as CalibratedNumber,
    CalibrationUse as CalibrationUse,
    Pipeline as Pipeline,
    RunSettings as RunSettings,
    Source as Source,
    Track as Track,
    build_parts as build_parts,
    build_pipeline as build_pipeline,
    load_pipeline as load_pipeline,
    plain_settings as plain_settings,
    plugin_files as plugin_files,
    ports_of as ports_of,
    resolved_text as resolved_text,
    taken_values as taken_values,
    wrong_channels as wrong_channels,
)
from palpate.config.doubts import UNCHECKED as UNCHECKED
from palpate.config.known import READINGS as READINGS, declared_std as declared_std
from palpate.config.migrations import FORMAT as FORMAT, KEY as KEY
from palpate.contact import force_slopes as force_slopes
from palpate.device import (
    address as address,
    ask_devices as ask_devices,
    is_live as is_live,
    own_motions as own_motions,
    truth_of as truth_of,
)
from palpate.errors import ConsentError as ConsentError, StoppedError as StoppedError, suggest as suggest
from palpate.extensions import function_of as function_of
from palpate.flags import SEVERITIES as SEVERITIES, verdict as verdict
from palpate.hooks import KINDS as KINDS
from palpate.input_file import Enclosure as Enclosure
from palpate.parts import (
    nested_settings as nested_settings,
    numbers_of as numbers_of,
    part_kind as part_kind,
)
from palpate.pipeline import (
    Flow as Flow,
    Guard as Guard,
    LiveLinks as LiveLinks,
    Result as Result,
    check_way as check_way,
    declared_noise as declared_noise,
    each as each,
    interruptible as interruptible,
    payloads as payloads,
    run_pipeline as run_pipeline,
    start_tracks as start_tracks,
    the_trajectory as the_trajectory,
)
from palpate.registry import FlagEntry as FlagEntry, Registry as Registry, analysis as analysis
from palpate.result import (
    GIVEN as GIVEN,
    PIPELINE as PIPELINE,
    RESULT as RESULT,
    SCHEMA as SCHEMA,
    Derived as Derived,
    Found as Found,
    TrackResult as TrackResult,
    acceleration as acceleration,
    finite_tree as finite_tree,
    make_folder as make_folder,
    withdraw_folder as withdraw_folder,
)
from palpate.safety import (
    MotionLimits as MotionLimits,
    MotionReport as MotionReport,
    Reach as Reach,
    SafetySettings as SafetySettings,
    check_motion as check_motion,
    check_own_motion as check_own_motion,
    demand_safe as demand_safe,
)
from palpate.trust import (
    PluginFile as PluginFile,
    announce as announce,
    approved as approved,
    approved_plugins as approved_plugins,
    inherited_approval as inherited_approval,
    trust_plugin as trust_plugin,
    trusted_plugins as trusted_plugins,
)
from palpate.units import Quantity as Quantity, dimension as dimension, display_unit as display_unit
from palpate.writing import whole_file as whole_file, write_new as write_new, write_whole as write_whole

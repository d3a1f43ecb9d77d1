"""The engine of one run: load a pipeline, run it, read its result, call an analysis by name."""

from .alignment import (
    GRAVITY as GRAVITY,
    Aligner as Aligner,
    AlignmentReport as AlignmentReport,
    AlignmentSettings as AlignmentSettings,
    Health as Health,
    Hesitations as Hesitations,
    Intake as Intake,
    Ports as Ports,
    SidewaysShare as SidewaysShare,
    Signal as Signal,
    hesitations as hesitations,
    mounting_of as mounting_of,
)
from .alignment.change_point import change_point as change_point
from .atomic_files import (
    file_in_place as file_in_place,
    whole_file as whole_file,
    write_new as write_new,
    write_whole as write_whole,
)
from .config import (
    Pipeline as Pipeline,
    RunSettings as RunSettings,
    Source as Source,
    Track as Track,
    build_parts as build_parts,
    build_pipeline as build_pipeline,
    load_pipeline as load_pipeline,
    parsed_assignment as parsed_assignment,
    plain_settings as plain_settings,
    plugin_files as plugin_files,
    ports_of as ports_of,
    resolved_text as resolved_text,
    values_on_trust as values_on_trust,
    wrong_channels as wrong_channels,
)
from .config.declared_uncertainties import (
    POISSON_RANGE as POISSON_RANGE,
    POISSON_STD as POISSON_STD,
    READINGS as READINGS,
    declared_std as declared_std,
)
from .config.dialects import (
    DIALECT as DIALECT,
    dialect_tables as dialect_tables,
    with_dialect as with_dialect,
)
from .config.file_version import FORMAT as FORMAT, KEY as KEY
from .config.rig_facts import (
    MEASURED as MEASURED,
    MEASUREMENT as MEASUREMENT,
    NO_SETTINGS as NO_SETTINGS,
    RIG as RIG,
    RigFacts as RigFacts,
    facts_of as facts_of,
    facts_stated as facts_stated,
    option_of as option_of,
    position_of as position_of,
    question_of as question_of,
    read_rig as read_rig,
    remedy_of as remedy_of,
    words_that_state as words_that_state,
)
from .config.rig_settings import (
    facts_left_open as facts_left_open,
    facts_set as facts_set,
    plain_facts as plain_facts,
    rig_assignments as rig_assignments,
)
from .config.tip_words import (
    is_ball as is_ball,
    is_same_tip as is_same_tip,
    tip_table as tip_table,
    tip_values as tip_values,
)
from .config.unit_plausibility import UNCHECKED as UNCHECKED
from .core_names import (
    FORMER_FLAGS as FORMER_FLAGS,
    KINDS as KINDS,
    SEVERITIES as SEVERITIES,
    ConsentError as ConsentError,
    Enclosure as Enclosure,
    Entry as Entry,
    FlagEntry as FlagEntry,
    PluginSwitch as PluginSwitch,
    Quantity as Quantity,
    Registry as Registry,
    SoundForce as SoundForce,
    StoppedError as StoppedError,
    advance_states as advance_states,
    analysis as analysis,
    announce as announce,
    approved_files as approved_files,
    approved_plugins as approved_plugins,
    ask_devices as ask_devices,
    bounded_text as bounded_text,
    context_of as context_of,
    deprecated_uses as deprecated_uses,
    dimension as dimension,
    display_unit as display_unit,
    error_text as error_text,
    force_slopes as force_slopes,
    function_of as function_of,
    import_plugin_file as import_plugin_file,
    inherited_approval as inherited_approval,
    input_files as input_files,
    is_live as is_live,
    is_open as is_open,
    json_document as json_document,
    needs_fact as needs_fact,
    nested_settings as nested_settings,
    numbers_of as numbers_of,
    only_plugins as only_plugins,
    own_motions as own_motions,
    part_kind as part_kind,
    plugin_file_of as plugin_file_of,
    registry as registry,
    safe_processes as safe_processes,
    toml_tables as toml_tables,
    trust_plugin as trust_plugin,
    trusted_plugins as trusted_plugins,
    unpromised_uses as unpromised_uses,
    verdict as verdict,
    verdict_rank as verdict_rank,
    verdict_word as verdict_word,
)
from .pipeline import (
    Flow as Flow,
    RecordOutcome as RecordOutcome,
    RecordTracks as RecordTracks,
    Result as Result,
    check_approach as check_approach,
    declared_noise as declared_noise,
    each as each,
    interruptible as interruptible,
    payloads as payloads,
    refuse_rehearsal as refuse_rehearsal,
    run_flow as run_flow,
    run_pipeline as run_pipeline,
    single_trajectory as single_trajectory,
    start_tracks as start_tracks,
)
from .pipeline.live.guard import Guard as Guard
from .pipeline.live.links import LiveLinks as LiveLinks
from .pipeline.provenance import library_versions as library_versions
from .result import (
    GIVEN as GIVEN,
    PIPELINE as PIPELINE,
    RESULT as RESULT,
    SCHEMA as SCHEMA,
    DerivedValue as DerivedValue,
    TrackComparison as TrackComparison,
    TrackResult as TrackResult,
    UncertainValue as UncertainValue,
    acceleration as acceleration,
    finite_tree as finite_tree,
    make_folder as make_folder,
    withdraw_folder as withdraw_folder,
)
from .result.materiality import row_words as row_words
from .result.track_result import TrackSummary as TrackSummary
from .safety import (
    MotionLimits as MotionLimits,
    MotionReport as MotionReport,
    Reach as Reach,
    SafetySettings as SafetySettings,
    check_motion as check_motion,
    check_own_motion as check_own_motion,
    demand_safe as demand_safe,
)
from .safety.emergency import EMERGENCY as EMERGENCY, call_for_stop as call_for_stop
from .safety.force_rise import RiseWatch as RiseWatch
from .safety.reading_age import ReadingAge as ReadingAge
from .safety.rest_window import RestWindow as RestWindow
from .safety.touch_begin import TouchSlope as TouchSlope, touch_outlier_text as touch_outlier_text
from .safety.touch_watch import TouchWatch as TouchWatch
from .track_name import TrackName as TrackName

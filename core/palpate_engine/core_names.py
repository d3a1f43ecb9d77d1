"""Names of the core for code that loads pipelines, reads the registry or asks for consent; no part needs them."""

# ruff: noqa: F401
# mypy: implicit-reexport

from palpate import registry
from palpate.contact import advance_states, force_slopes
from palpate.device import ask_devices, is_live, own_motions
from palpate.discovery import import_plugin_file, plugin_file_of
from palpate.entries import Entry, FlagEntry
from palpate.errors import ConsentError, StoppedError, error_text
from palpate.evidence.condition import FORMER_FLAGS
from palpate.flags import SEVERITIES, is_open, needs_fact, verdict, verdict_rank, verdict_word
from palpate.hooks import KINDS
from palpate.input_file import Enclosure, bounded_text, json_document, toml_tables
from palpate.interface import deprecated_uses, unpromised_uses
from palpate.offers import context_of, function_of
from palpate.parts import input_files, nested_settings, numbers_of, part_kind
from palpate.plugin_switch import PluginSwitch, only_plugins
from palpate.registry import Registry, analysis
from palpate.safe_path import safe_processes
from palpate.sound_force import SoundForce
from palpate.trust import announce, approved_files, approved_plugins, inherited_approval, trust_plugin, trusted_plugins
from palpate.units import Quantity, dimension, display_unit

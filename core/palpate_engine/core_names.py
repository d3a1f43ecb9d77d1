"""Names of the core for code that loads pipelines, reads the registry or asks for consent; no part needs them."""

from palpate import registry
from palpate.contact import force_slopes
from palpate.device import ask_devices, is_live, own_motions, truth_of
from palpate.discovery import import_plugin_file, plugin_file_of
from palpate.errors import ConsentError, StoppedError
from palpate.flags import SEVERITIES, verdict, verdict_word
from palpate.hooks import KINDS
from palpate.input_file import Enclosure
from palpate.offers import function_of
from palpate.parts import input_files, nested_settings, numbers_of, part_kind
from palpate.registry import FlagEntry, Registry, analysis
from palpate.trust import announce, approved_files, approved_plugins, inherited_approval, trust_plugin, trusted_plugins
from palpate.units import Quantity, dimension, display_unit

__all__ = [
    "KINDS",
    "SEVERITIES",
    "ConsentError",
    "Enclosure",
    "FlagEntry",
    "Quantity",
    "Registry",
    "StoppedError",
    "analysis",
    "announce",
    "approved_files",
    "approved_plugins",
    "ask_devices",
    "dimension",
    "display_unit",
    "force_slopes",
    "function_of",
    "import_plugin_file",
    "inherited_approval",
    "input_files",
    "is_live",
    "nested_settings",
    "numbers_of",
    "own_motions",
    "part_kind",
    "plugin_file_of",
    "registry",
    "trust_plugin",
    "trusted_plugins",
    "truth_of",
    "verdict",
    "verdict_word",
]

"""Discovery of plugins: installed ones and named files, their offers, and the faults in them."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from inspect import isabstract, isfunction
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import pluggy

from palpate import core_flags, hooks
from palpate.claims import settle_claims
from palpate.errors import RAISED_BY_PARTS, PluginError, suggest
from palpate.installed_plugins import SHIPPED_BY, installed_plugins
from palpate.interface import interface_problem, stated_api
from palpate.plugin_origin import Plugin, normalized_name
from palpate.plugin_switch import PluginSwitch
from palpate.safe_path import without_current_folder
from palpate.trust import PluginFile

_PREFIX = "palpate_"
_SOURCE = "__palpate_source__"  # what a plugin file's module is of

_Checked = TypeVar("_Checked")


_CORE = Plugin(SHIPPED_BY, own=True)


@dataclass(frozen=True)
class Discovery:
    """Every plugin that could be loaded, and what failed in installed ones."""

    manager: pluggy.PluginManager
    failures: dict[str, str]  # by plugin: a sentence that names it; of its hooks as they are asked
    shipped: frozenset[str]  # names of palpate's own plugins
    left_out: tuple[str, ...] = ()  # sentences on distributions that PALPATE_PLUGINS does not name
    clashes: list[str] = field(default_factory=list)  # sentences on names that several plugins claim, as they are asked
    ambiguous: dict[tuple[str, str], str] = field(default_factory=dict)  # by kind and name: those that nobody owns

    @cached_property
    def plugins(self) -> dict[Any, Plugin]:
        """Every plugin but the core itself, by its module."""
        return {
            module: Plugin(
                name=name,
                place=getattr(module, "__file__", None) or "",
                own=name in self.shipped,
                digest=_digest(module),
                api=stated_api(module),
            )
            for name, module in self.manager.list_name_plugin()
            if module is not core_flags
        }

    @property
    def oddities(self) -> tuple[str, ...]:
        """Sentences on parts of loaded plugins that are not as they were meant."""
        sentences = list(self.clashes)
        for module, plugin in self.plugins.items():
            sentences += _oddities(module, plugin)
        return tuple(sentences)

    def named(self, kind: str, hook: str, root: type) -> dict[str, tuple[Any, Plugin]]:
        """Return everything of a kind by name, with its plugin; raises PluginError like `settle_claims`."""
        return self._settled(kind, self._offers(hook, lambda offer: dict(_checked(offer, kind, root))))

    @property
    def offers(self) -> dict[str, dict[str, Any]]:
        """The offers of `palpate_offers`: by field of the registry, by name; raises PluginError like `named`."""
        answers = list(self._offers("palpate_offers", _checked_kinds))
        answers.sort(key=lambda answer: not answer[0].is_file)  # of which one is used, the user's file goes first
        return {
            field: {
                name: offer
                for name, (offer, _) in self._settled(
                    kind, ((plugin, kinds[kind]) for plugin, kinds in answers if kind in kinds)
                ).items()
            }
            for kind, (field, _) in hooks.OFFERS.items()
        }

    def _settled(self, kind: str, offers: Iterable[tuple[Plugin, Mapping[str, Any]]]) -> dict[str, tuple[Any, Plugin]]:
        """Return the offers of a kind by the name that reaches each; names that several plugins claim are noted."""
        claims = settle_claims(kind, offers)
        self.clashes.extend(claims.notices)
        self.ambiguous.update({(kind, name): sentence for name, sentence in claims.ambiguous.items()})
        return claims.offers

    def _offers(self, hook: str, check: Callable[[Any], _Checked]) -> Iterator[tuple[Plugin, _Checked]]:
        """Yield the answer of each plugin, and of the core, to a hook, as `check` returns it.

        A hook that raises or answers anything else is noted in `failures`, and the others are asked; raises PluginError
        where it is that of a file, which the user can correct.
        """
        functions = {answer.plugin: answer.function for answer in getattr(self.manager.hook, hook).get_hookimpls()}
        for module, plugin in {core_flags: _CORE, **self.plugins}.items():
            if module not in functions:
                continue
            # One plugin at a time, so that an error is that plugin's.
            try:
                offer = functions[module]()
            except RAISED_BY_PARTS as error:  # whatever third-party code raises
                self._fail(plugin, f"{hook} raises {_cause(error)} ({_place(error, plugin)})", error)
                continue
            if offer is None:
                continue
            try:
                checked = check(offer)
            except Exception as error:
                self._fail(plugin, f"{hook} {error}", error)
            else:
                yield plugin, checked

    def _fail(self, plugin: Plugin, problem: str, error: BaseException) -> None:
        """Note a problem of an installed plugin; raise PluginError for a file, which its user can correct."""
        if plugin.is_file:
            raise PluginError(f"plugin {plugin.name}: {problem}") from error
        before = self.failures.get(plugin.name)
        self.failures[plugin.name] = f"{before}; {problem}" if before else f"plugin {plugin.name}: {problem}"


def discover(files: Iterable[Path | PluginFile] = ()) -> Discovery:
    """Load every installed plugin and the given files; raises PluginError where a file fails to import."""
    manager = pluggy.PluginManager(hooks.PROJECT)
    manager.add_hookspecs(hooks)
    manager.register(core_flags, "palpate")
    failures: dict[str, str] = {}
    installed = installed_plugins(tuple(sys.path))
    # Installed plugins, of third parties those that the user admits.
    switch = PluginSwitch.of_environment()
    third_parties = {plugin.name: normalized_name(plugin.distribution) for plugin in installed if not plugin.own}
    for plugin in installed:
        name = plugin.name
        if name in third_parties and not switch.admits(third_parties[name]):
            continue
        try:
            module = plugin.load()
            if problem := interface_problem(module):
                failures[name] = f"plugin {name} is left out: {problem}"
                continue
            _register(manager, module, name)
        except RAISED_BY_PARTS as error:  # whatever a third-party import raises
            failures[name] = f"plugin {name} could not be loaded: {_cause(error)}{_import_place(error)}"
    for path in files:
        _register_file(manager, path if isinstance(path, PluginFile) else PluginFile.read(path))
    shipped = frozenset(plugin.name for plugin in installed if plugin.own)
    return Discovery(manager, failures, shipped, switch.left_out(third_parties))


def _register_file(manager: pluggy.PluginManager, file: PluginFile) -> None:
    """Import a plugin file and register it; raises PluginError where either fails."""
    module = import_plugin_file(file)
    if problem := interface_problem(module):
        raise PluginError(f"plugin file {file.path}: {problem}")
    try:
        _register(manager, module, str(file.path))
    except Exception as error:
        raise PluginError(f"plugin file {file.path} could not be loaded: {_cause(error)}") from error


def _import_place(error: BaseException) -> str:
    """Return `` (own.py, line 7)``, the last line of a plugin that an import was at; a syntax error says it itself."""
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if Path(frame.filename).exists()]
    core = Path(__file__).parent
    of_others = [frame for frame in frames if "importlib" not in frame.filename and Path(frame.filename).parent != core]
    if isinstance(error, SyntaxError) or not of_others:
        return ""
    return f" ({Path(of_others[-1].filename).name}, line {of_others[-1].lineno})"


def _cause(error: BaseException) -> str:
    """Return ``KeyError: 'lost'``, in one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())


def _place(error: BaseException, plugin: Plugin) -> str:
    """Return ``own.py, line 7``: the place in a plugin's own file that raised, or called the code that did."""
    frames = traceback.extract_tb(error.__traceback__)
    plugin_frames = [frame for frame in frames if frame.filename == plugin.place] or frames
    return f"{Path(plugin_frames[-1].filename).name}, line {plugin_frames[-1].lineno}"


def missing_methods(part: Any) -> str:
    """Return the methods and constants of a part's kind that the part does not define; empty if none is missing."""
    constants = {name for name in getattr(part, "__class_vars__", ()) if not hasattr(part, name)}
    return ", ".join(sorted(constants.union(part.__abstractmethods__ if isabstract(part) else ())))


def _register(manager: pluggy.PluginManager, module: ModuleType, name: str) -> None:
    """Register a plugin; where pluggy refuses one of its hooks, none of them stays."""
    was_registered = manager.has_plugin(name)
    try:
        manager.register(module, name)
    except Exception:
        if not was_registered:
            manager.unregister(name=name)
        raise


def import_plugin_file(file: PluginFile) -> ModuleType:
    """Return the module of a file: that of the last time if it is unchanged, so that its classes stay the same.

    Its content is compiled as it was read: another file there by now, or compiled code next to it, is not executed.
    Nor is a file next to it that it imports. Raises PluginError.
    """
    name = f"palpate_file_{file.path.stem}"
    before = sys.modules.get(name)
    if before is not None and _executes(before, file):
        return before
    module = ModuleType(name)
    module.__file__, module.__package__ = str(file.path), ""
    sys.modules[name] = module
    try:
        with without_current_folder():
            exec(compile(file.content, str(file.path), "exec", dont_inherit=True), module.__dict__)
    except RAISED_BY_PARTS as error:
        problem = f"{_cause(error)}{_import_place(error)}{_advice(error, file.path)}"
        raise PluginError(f"plugin file {file.path} fails to import: {problem}") from error
    module.__dict__[_SOURCE] = file
    return module


def _advice(error: BaseException, path: Path) -> str:
    """Return the remedy for an import from the folder of a plugin file; empty for any other error."""
    name = (getattr(error, "name", None) or "").partition(".")[0]
    is_neighbour = bool(name) and (path.with_name(f"{name}.py").exists() or (path.parent / name).is_dir())
    if not isinstance(error, ImportError) or not (is_neighbour or "relative import" in str(error)):
        return ""
    return (
        f"; nothing is imported from the folder of a plugin file, since approval covers {path.name} alone: move the "
        "code into it, or install both as a distribution (pip install)"
    )


def _executes(module: ModuleType, file: PluginFile) -> bool:
    """Return True if a module executes the content of a file, under its path."""
    source = plugin_file_of(module)
    return source is not None and (source.path.resolve(), source.content) == (file.path.resolve(), file.content)


def plugin_file_of(module: Any) -> PluginFile | None:
    """Return the plugin file whose content a module executes; None for an installed one."""
    source = getattr(module, _SOURCE, None)
    return source if isinstance(source, PluginFile) else None


def _digest(module: Any) -> str:
    """Return the SHA-256 of a plugin file's content; empty for an installed plugin."""
    file = plugin_file_of(module)
    return file.digest if file else ""


def _oddities(module: Any, plugin: Plugin) -> Iterator[str]:
    """Yield sentences on functions that look like hooks but are not, and on a plugin without any."""
    # Functions that pluggy has marked, and those that are named like hooks.
    hook_names = {name for name in vars(hooks) if name.startswith(_PREFIX)}
    marked = {name for name, item in vars(module).items() if hasattr(item, f"{hooks.PROJECT}_impl")}
    named = {name for name, item in vars(module).items() if isfunction(item) and name.startswith(_PREFIX)}
    # Names of former hooks, of one kind of offer each, with what palpate_offers returns in their place.
    former = {f"{_PREFIX}{field}": f"{{{kind!r}: ...}}" for kind, (field, _) in hooks.OFFERS.items()}
    for name in sorted(marked - hook_names):
        hint = f": return it as {former[name]} from palpate_offers" if name in former else suggest(name, hook_names)
        yield f"plugin {plugin.name}: {name} is not a hook{hint}"
    for name in sorted(named - marked):
        hint = "" if name in hook_names else f", and is not a hook{suggest(name, hook_names)}"
        yield f"plugin {plugin.name}: {name} is not marked @palpate.plugin{hint}"
    if not marked & hook_names and not marked | named:
        yield f"plugin {plugin.name} offers nothing: it has no function marked @palpate.plugin, such as palpate_models"


def _checked_kinds(offer: Any) -> dict[str, dict[str, Any]]:
    """Return items of `palpate_offers` by kind; raises PluginError for an unknown kind, or an item not of its kind."""
    if not isinstance(offer, Mapping):
        raise PluginError(f"returns {offer!r}, not a mapping of kinds")
    for kind in offer:
        if kind not in hooks.OFFERS:
            raise PluginError(f"returns {kind!r}, which is not a kind of offer{suggest(str(kind), hooks.OFFERS)}")
    return {kind: dict(_checked(items, kind, hooks.OFFERS[kind][1])) for kind, items in offer.items()}


def _checked(offer: Any, kind: str, root: type) -> Iterator[tuple[str, Any]]:
    """Yield the items of an offer by name; raises PluginError where it is not a mapping, or one is not of the kind.

    Items of the kind are objects or subclasses of its `root` class, or "module:class" of a part.
    """
    if not isinstance(offer, Mapping):
        raise PluginError(f"returns {offer!r}, not a mapping of names")
    for name, item in offer.items():
        if not isinstance(name, str) or ":" in name:
            raise PluginError(f"offers {name!r}, which is not a name")
        if isinstance(item, str) and ":" in item and kind in hooks.KINDS:
            yield name, item  # a part that is imported when it is asked for
            continue
        if not (isinstance(item, root) or (isinstance(item, type) and issubclass(item, root))):
            raise PluginError(f"offers {name!r}, which is not of kind {root.__name__}")
        if isinstance(item, type) and (missing := missing_methods(item)):
            raise PluginError(f"offers {name!r} ({item.__name__}), which does not define {missing}")
        yield name, item

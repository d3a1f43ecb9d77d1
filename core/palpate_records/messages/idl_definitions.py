"""ROS 2 message definitions as IDL (OMG IDL 4.2, what of it ``rosidl`` writes): the text, parsed into fields."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from math import prod

from palpate import LogError

from palpate_records.messages.fields import Field

# What is opened and never closed goes to the end: looking for its end again from every place would take hours.
_TOKEN = re.compile(
    r'"(?:\\.|[^"\\])*(?:"|\\?\Z)|\'(?:\\.|[^\'\\])*(?:\'|\\?\Z)|(?:::)?[A-Za-z_]\w*(?:::[A-Za-z_]\w*)*|[\d.][\w.+-]*|\S',
    re.DOTALL,
)
_COMMENT = re.compile(r'("(?:\\.|[^"\\])*(?:"|\\?\Z))|//[^\n]*|/\*.*?(?:\*/|\Z)', re.DOTALL)
_LINE = re.compile(r"^(?:#.*|=+\s*|IDL:.*)$", re.MULTILINE)  # of the preprocessor, and between types in a log
_BEGIN = re.compile(r"(?:module|struct|typedef|enum|const)\s+\w|@\w")
_NAMES = {
    "boolean": "bool",
    "octet": "byte",
    "char": "uint8",
    "short": "int16",
    "unsigned short": "uint16",
    "long": "int32",
    "unsigned long": "uint32",
    "long long": "int64",
    "unsigned long long": "uint64",
    "float": "float32",
    "double": "float64",
    **{f"{sign}int{bits}": f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)},
}
_DEPTH = 16  # of modules, and of arrays
_MOST = (1 << 32) - 1  # elements of an array
_SHOWN = 200  # characters of a problem
_TEXTS = ("string", "wstring")


def is_idl(text: str) -> bool:
    """Return True if a definition is IDL, and no ``.msg``.

    >>> is_idl("module a { module msg { struct B { double x; }; }; };"), is_idl("float64 x")
    (True, False)
    """
    return _BEGIN.match(_plain(text).lstrip()) is not None


def parse_idl(owner: str, text: str) -> dict[str, tuple[Field, ...]]:
    """Return the fields of every structure of an IDL text by its short name; raises LogError where it cannot be
    read."""
    parser = _Parser(owner, _TOKEN.findall(_plain(text)))
    parser.definitions([])
    return parser.structures


def _plain(text: str) -> str:
    return _LINE.sub("", _COMMENT.sub(lambda match: match[1] or " ", text))


@dataclass
class _Parser:
    owner: str
    tokens: list[str]
    at: int = 0
    structures: dict[str, tuple[Field, ...]] = field(default_factory=dict)
    aliases: dict[str, Field] = field(default_factory=dict)
    constants: dict[str, str] = field(default_factory=dict)

    def definitions(self, scope: list[str]) -> None:
        """All up to the end of a module, or of the text."""
        if len(scope) > _DEPTH:
            raise self._damage(f"modules within modules, {len(scope)} deep")
        while self.at < len(self.tokens) and self.tokens[self.at] != "}":
            self._annotations()
            match self._next():
                case "module":
                    name = self._next()
                    self._demand("{")
                    self.definitions([*scope, name])
                    self._demand("}")
                case "struct":
                    self._struct(scope)
                case "typedef":
                    for found in self._declared(scope):
                        self.aliases[_joined(scope, found.name)] = found
                case "enum":
                    name = self._next()
                    self.aliases[_joined(scope, name)] = Field(name, "uint32")
                    self._skip_to("}")
                    self._demand("}")
                case "const":
                    self._constant(scope)
                case other:
                    raise self._damage(f"{other!r} is not a module, struct, typedef, enum or const")
            self._demand(";")

    def _struct(self, scope: list[str]) -> None:
        name = self._next()
        if self._peek() != "{":
            raise self._damage(f"struct {name} is derived from another, or has no members")
        self._demand("{")
        members: list[Field] = []
        while self._peek() != "}":
            self._annotations()
            members += self._declared([*scope, name])
            self._demand(";")
        self._demand("}")
        self.structures[_short([*scope, name])] = tuple(members)

    def _constant(self, scope: list[str]) -> None:
        begin = self.at
        self._skip_to(";")
        words = self.tokens[begin : self.at]
        if "=" in words:
            self.constants[_joined(scope, words[words.index("=") - 1])] = words[-1]

    def _declared(self, scope: list[str]) -> list[Field]:
        """Names of one type, each with its own dimensions."""
        kind, found = self._type(scope), list[Field]()
        while True:
            name, sizes = self._next(), list[int]()
            while self._peek() == "[":
                self._demand("[")
                sizes.append(self._size(scope))
                self._demand("]")
                if prod(sizes) > _MOST or len(sizes) > _DEPTH:
                    raise self._damage(f"{name} has more than {_MOST} elements, or {_DEPTH} dimensions")
            if sizes and kind.many and kind.count is None:
                raise self._damage(f"{name} is an array of sequences")
            count = prod(sizes) * (kind.count or 1) if sizes else kind.count
            if count is not None and count > _MOST:
                raise self._damage(f"{name} has more than {_MOST} elements")
            found.append(Field(name, kind.type, count, kind.many or bool(sizes)))
            if self._peek() != ",":
                return found
            self._demand(",")

    def _type(self, scope: list[str]) -> Field:
        word = self._next()
        if word == "sequence":
            self._demand("<")
            inside = Field("", "", None, many=True) if self._peek() == "sequence" else self._type(scope)
            if inside.many:
                raise self._damage("a sequence of sequences or arrays")
            self._bound(scope, ",")
            self._demand(">")
            return Field("", inside.type, None, many=True)
        if word in _TEXTS:
            self._bound(scope, "<")
            if self._peek() == ">":
                self._demand(">")
            return Field("", word)
        while word in ("unsigned", "long", "unsigned long") and self._peek() in ("short", "long", "double"):
            word += f" {self._next()}"
        if word in _NAMES:
            return Field("", _NAMES[word])
        if "::" not in word and word in ("wchar", "long double", "any", "fixed", "map", "union", "struct"):
            raise self._damage(f"{word!r} is not a type that messages of ROS 2 have")
        return self._named(scope, word)

    def _named(self, scope: list[str], word: str) -> Field:
        for inner in range(len(scope), -1, -1):
            path = [*scope[:inner], *word.removeprefix("::").split("::")]
            if alias := self.aliases.get("::".join(path)):
                return alias
            if _short(path) in self.structures:
                return Field("", _short(path))
        return Field("", _short([*(scope[:-1] if "::" not in word else []), *word.removeprefix("::").split("::")]))

    def _bound(self, scope: list[str], before: str) -> None:
        """Largest number of elements; a message states its own."""
        if self._peek() == before:
            self._demand(before)
            self._size(scope)

    def _size(self, scope: list[str]) -> int:
        word = self._next()
        for inner in range(len(scope), -1, -1):
            word = self.constants.get(_joined(scope[:inner], word.removeprefix("::")), word)
        if not (word.isascii() and word.isdigit() and len(word) <= len(str(_MOST))) or not 1 <= int(word) <= _MOST:
            raise self._damage(f"{word[:20]!r} is not a number of elements (1 to {_MOST})")
        return int(word)

    def _annotations(self) -> None:
        while self._peek() == "@":
            self.at += 2
            if self._peek() == "(":
                deep = 0
                while True:
                    word = self._next()
                    deep += (word == "(") - (word == ")")
                    if not deep:
                        break

    def _peek(self) -> str:
        return self.tokens[self.at] if self.at < len(self.tokens) else ""

    def _next(self) -> str:
        if self.at >= len(self.tokens):
            raise self._damage("it ends too early")
        self.at += 1
        return self.tokens[self.at - 1]

    def _demand(self, word: str) -> None:
        if self._peek() != word:
            raise self._damage(f"{self._peek() or 'the end'!r} where {word!r} is to be")
        self.at += 1

    def _skip_to(self, word: str) -> None:
        while self._peek() != word:
            self._next()

    def _damage(self, problem: str) -> LogError:
        return LogError(f"the definition of {self.owner} cannot be read as IDL: {problem[:_SHOWN]}")


def _joined(scope: list[str], name: str) -> str:
    return "::".join([*scope, name])


def _short(path: list[str]) -> str:
    """Return a structure's short name; what DDS appends to names of ROS is taken away.

    >>> _short(["lab_msgs", "msg", "Load"]), _short(["lab_msgs", "msg", "dds_", "Load_"])
    ('lab_msgs/Load', 'lab_msgs/Load')
    """
    name = path[-1].removesuffix("_") if "dds_" in path[:-1] else path[-1]
    return f"{path[0]}/{name}" if len(path) > 1 else name

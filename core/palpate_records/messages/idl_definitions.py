"""ROS 2 message definitions as IDL (OMG IDL 4.2, the part that ``rosidl`` writes): the text, parsed into fields."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from math import prod

from palpate import LogError

from palpate_records.messages.fields import Field

# A text or comment that is never closed goes to the end: a search for its end from every place would take hours.
_TOKEN = re.compile(
    r'"(?:\\.|[^"\\])*(?:"|\\?\Z)|\'(?:\\.|[^\'\\])*(?:\'|\\?\Z)|(?:::)?[A-Za-z_]\w*(?:::[A-Za-z_]\w*)*|[\d.][\w.+-]*|\S',
    re.DOTALL,
)
_COMMENT = re.compile(r'("(?:\\.|[^"\\])*(?:"|\\?\Z))|//[^\n]*|/\*.*?(?:\*/|\Z)', re.DOTALL)
_LINE = re.compile(r"^(?:#.*|=+\s*|IDL:.*)$", re.MULTILINE)  # of the preprocessor, and between types in a log
_BEGIN = re.compile(r"(?:module|struct|typedef|enum|const)\s+\w|@\w")
_PRIMITIVE_NAMES = {
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
_MAX_DEPTH = 16  # of modules in modules, and dimensions of arrays: a choice
_MAX_ELEMENTS = (1 << 32) - 1  # of an array, by CDR
_MAX_SHOWN = 200  # characters of a problem: a choice
_TEXTS = ("string", "wstring")


def is_idl(text: str) -> bool:
    """Return True if a definition is IDL, and no ``.msg``.

    >>> is_idl("module a { module msg { struct B { double x; }; }; };"), is_idl("float64 x")
    (True, False)
    """
    return _BEGIN.match(_without_comments(text).lstrip()) is not None


def parse_idl(owner: str, text: str) -> dict[str, tuple[Field, ...]]:
    """Return the fields of every structure of an IDL text by its short name; raises LogError."""
    parser = _Parser(owner, _TOKEN.findall(_without_comments(text)))
    parser.parse_definitions([])
    return parser.structures


def _without_comments(text: str) -> str:
    """Return a text without comments and lines of the preprocessor."""
    return _LINE.sub("", _COMMENT.sub(lambda match: match[1] or " ", text))


@dataclass
class _Parser:
    """A parser of the tokens of one text; a scope is the list of names of the modules and structures around."""

    owner: str
    tokens: list[str]
    position: int = 0  # of the next token
    structures: dict[str, tuple[Field, ...]] = field(default_factory=dict)
    aliases: dict[str, Field] = field(default_factory=dict)
    constants: dict[str, str] = field(default_factory=dict)

    def parse_definitions(self, scope: list[str]) -> None:
        """Parse all definitions up to the end of a module, or of the text; `scope` are the names of its modules.

        Raises LogError.
        """
        if len(scope) > _MAX_DEPTH:
            raise self._damage(f"modules within modules, {len(scope)} deep")
        while self.position < len(self.tokens) and self.tokens[self.position] != "}":
            self._skip_annotations()
            match self._next():
                case "module":
                    name = self._next()
                    self._demand("{")
                    self.parse_definitions([*scope, name])
                    self._demand("}")
                case "struct":
                    self._parse_struct(scope)
                case "typedef":
                    for declaration in self._parse_declarations(scope):
                        self.aliases[_scoped_name(scope, declaration.name)] = declaration
                case "enum":
                    name = self._next()
                    # The names of an enumeration are constants: a message has a number.
                    self.aliases[_scoped_name(scope, name)] = Field(name, "uint32")
                    self._skip_to("}")
                    self._demand("}")
                case "const":
                    self._parse_constant(scope)
                case other:
                    raise self._damage(f"{other!r} is not a module, struct, typedef, enum or const")
            self._demand(";")

    def _parse_struct(self, scope: list[str]) -> None:
        """Add a structure."""
        name = self._next()
        if self._peek() != "{":
            raise self._damage(f"struct {name} is derived from another, or has no members")
        self._demand("{")
        members: list[Field] = []
        while self._peek() != "}":
            self._skip_annotations()
            members += self._parse_declarations([*scope, name])
            self._demand(";")
        self._demand("}")
        self.structures[_short_name([*scope, name])] = tuple(members)

    def _parse_constant(self, scope: list[str]) -> None:
        """Add a constant: its name stands before "=", its value last."""
        begin = self.position
        self._skip_to(";")
        tokens = self.tokens[begin : self.position]
        if "=" in tokens:
            name = tokens[tokens.index("=") - 1]
            self.constants[_scoped_name(scope, name)] = tokens[-1]

    def _parse_declarations(self, scope: list[str]) -> list[Field]:
        """Return the fields of one type, each with its own dimensions; raises LogError for too many elements."""
        field_type = self._parse_type(scope)
        fields = list[Field]()
        while True:
            name = self._next()
            sizes = self._parse_dimensions(scope, name) if self._peek() == "[" else []
            if sizes and field_type.many and field_type.count is None:
                raise self._damage(f"{name} is an array of sequences")
            # All elements of an array of arrays; None: any number.
            count = prod(sizes) * (field_type.count or 1) if sizes else field_type.count
            if count is not None and count > _MAX_ELEMENTS:
                raise self._damage(f"{name} has more than {_MAX_ELEMENTS} elements")
            fields.append(Field(name, field_type.type, count, many=field_type.many or bool(sizes)))
            if self._peek() != ",":
                return fields
            self._demand(",")

    def _parse_dimensions(self, scope: list[str], name: str) -> list[int]:
        """Return the sizes in brackets behind a name."""
        sizes = list[int]()
        while self._peek() == "[":
            self._demand("[")
            sizes.append(self._parse_size(scope))
            self._demand("]")
            if prod(sizes) > _MAX_ELEMENTS or len(sizes) > _MAX_DEPTH:
                raise self._damage(f"{name} has more than {_MAX_ELEMENTS} elements, or {_MAX_DEPTH} dimensions")
        return sizes

    def _parse_type(self, scope: list[str]) -> Field:
        """Return a type as a field without a name; raises LogError for one that messages of ROS 2 do not have."""
        name = self._next()
        if name == "sequence":
            return self._parse_sequence(scope)
        if name in _TEXTS:
            self._skip_bound(scope, "<")
            if self._peek() == ">":
                self._demand(">")
            return Field("", name)
        # Names of several tokens, such as "unsigned long long".
        while name in ("unsigned", "long", "unsigned long") and self._peek() in ("short", "long", "double"):
            name += f" {self._next()}"
        if name in _PRIMITIVE_NAMES:
            return Field("", _PRIMITIVE_NAMES[name])
        if "::" not in name and name in ("wchar", "long double", "any", "fixed", "map", "union", "struct"):
            raise self._damage(f"{name!r} is not a type that messages of ROS 2 have")
        return self._named_type(scope, name)

    def _parse_sequence(self, scope: list[str]) -> Field:
        """Return a sequence of numbers, texts or structures."""
        self._demand("<")
        element = Field("", "", None, many=True) if self._peek() == "sequence" else self._parse_type(scope)
        if element.many:
            raise self._damage("a sequence of sequences or arrays")
        self._skip_bound(scope, ",")
        self._demand(">")
        return Field("", element.type, None, many=True)

    def _named_type(self, scope: list[str], name: str) -> Field:
        """Return the alias or structure of a name, in the innermost scope that has one; else one that comes later."""
        parts = name.removeprefix("::").split("::")
        for depth in range(len(scope), -1, -1):
            path = [*scope[:depth], *parts]
            if alias := self.aliases.get("::".join(path)):
                return alias
            if _short_name(path) in self.structures:
                return Field("", _short_name(path))
        return Field("", _short_name([*(scope[:-1] if "::" not in name else []), *parts]))

    def _skip_bound(self, scope: list[str], separator: str) -> None:
        """Skip the largest number of elements behind a separator; a message states its own number."""
        if self._peek() == separator:
            self._demand(separator)
            self._parse_size(scope)

    def _parse_size(self, scope: list[str]) -> int:
        """Return a number of elements, written as such or as the name of a constant; raises LogError."""
        text = self._next()
        for depth in range(len(scope), -1, -1):
            text = self.constants.get(_scoped_name(scope[:depth], text.removeprefix("::")), text)
        is_number = text.isascii() and text.isdigit() and len(text) <= len(str(_MAX_ELEMENTS))
        if not is_number or not 1 <= int(text) <= _MAX_ELEMENTS:
            raise self._damage(f"{text[:20]!r} is not a number of elements (1 to {_MAX_ELEMENTS})")
        return int(text)

    def _skip_annotations(self) -> None:
        """Skip "@name" and its arguments in parentheses."""
        while self._peek() == "@":
            self.position += 2
            if self._peek() == "(":
                depth = 0
                while True:
                    token = self._next()
                    depth += (token == "(") - (token == ")")
                    if not depth:
                        break

    def _peek(self) -> str:
        """Return the next token without reading it; "" at the end."""
        return self.tokens[self.position] if self.position < len(self.tokens) else ""

    def _next(self) -> str:
        """Read the next token; raises LogError at the end."""
        if self.position >= len(self.tokens):
            raise self._damage("it ends too early")
        self.position += 1
        return self.tokens[self.position - 1]

    def _demand(self, token: str) -> None:
        """Read a certain token; raises LogError for any other."""
        if self._peek() != token:
            raise self._damage(f"{self._peek() or 'the end'!r} where {token!r} is to be")
        self.position += 1

    def _skip_to(self, token: str) -> None:
        """Skip all tokens before a certain one."""
        while self._peek() != token:
            self._next()

    def _damage(self, problem: str) -> LogError:
        """Return the error of a definition that cannot be read."""
        return LogError(f"the definition of {self.owner} cannot be read as IDL: {problem[:_MAX_SHOWN]}")


def _scoped_name(scope: list[str], name: str) -> str:
    """Return a name with those of its scope."""
    return "::".join([*scope, name])


def _short_name(path: list[str]) -> str:
    """Return a structure's short name, without the additions of DDS to names of ROS.

    >>> _short_name(["lab_msgs", "msg", "Load"]), _short_name(["lab_msgs", "msg", "dds_", "Load_"])
    ('lab_msgs/Load', 'lab_msgs/Load')
    """
    name = path[-1].removesuffix("_") if "dds_" in path[:-1] else path[-1]
    return f"{path[0]}/{name}" if len(path) > 1 else name

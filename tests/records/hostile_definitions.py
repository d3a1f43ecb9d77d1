"""Definitions made to exhaust time or memory, with a message for each; by kind and name."""

import json
import struct
from collections.abc import Iterator

from google.protobuf import descriptor_pb2
from palpate_records.messages.topics import Topic

HEAD = b"\0\1\0\0"
MOST = (1 << 32) - 1
LONG = struct.pack("<I", MOST)
PART = "\n" + "=" * 80 + "\nMSG: "
MEGABYTE = 1 << 20


def _ros() -> Iterator[tuple[str, str, bytes]]:
    chain = [f"a/S{i}\nS{i + 1} x\nS{i + 1} y" for i in range(30)]
    yield "arrays of nothing", PART.join(["A[] a", "a/A\nB[1000] b", "a/B\n"]), LONG
    yield "arrays of arrays of nothing", PART.join(["A[1000] a", "a/A\nB[1000] b", "a/B\nC[1000] c", "a/C\n"]), b""
    yield "doubled thirty times", PART.join(["S0 s", *chain, "a/S30\nuint8 x"]), bytes(MEGABYTE)
    yield "doubled, of nothing", PART.join(["S0 s", *chain, "a/S30\n"]), bytes(MEGABYTE)
    yield "cycle of two", PART.join(["A a", "a/A\nB b", "a/B\nA a"]), bytes(100)
    yield "cycle through a sequence", PART.join(["A[] a", "a/A\nA[] a"]), LONG * 1000
    yield "a hundred thousand fields", "".join(f"bool a{i}\n" for i in range(80_000)), bytes(80_000)
    yield "a million fields", "".join(f"bool a{i}\n" for i in range(1_000_000)), bytes(1_000_000)
    yield "a hundred thousand texts", "".join(f"string a{i}\n" for i in range(70_000)), bytes(400_000)
    yield "array of 2^32 - 1", f"float64[{MOST}] x", LONG + bytes(1000)
    yield "bounded by 2^32 - 1", f"float64[<={MOST}] x\nstring<={MOST} s", LONG + bytes(1000)
    yield "texts of 2^32 - 1", "string a\nwstring b\nstring[] c", LONG + bytes(1000)
    yield "sequences of sequences", PART.join(["A[] a", "a/A\nB[] b", "a/B\nuint8[] c"]), LONG + bytes(10**6)
    yield "empty sequences", PART.join(["A[] a", "a/A\nuint8[] b"]), struct.pack("<I", 200_000) + bytes(800_000)
    yield "sections without end", "A a" + (PART + "a/A\nuint8 x") * 9000, bytes(100)
    yield "many types", PART.join(["A0 a", *(f"a/A{i}\nA{i + 1} x" for i in range(9000))]), bytes(100)
    yield "only a separator", "=" * MEGABYTE, b""
    yield "only blanks", " " * (MEGABYTE - 1) + "x", b""
    yield "one long name", "uint8 " + "n" * (MEGABYTE - 10), bytes(10)
    yield "quotes that stay open", "string s " + "'\"" * 500_000, bytes(10)
    yield "brackets", "uint8" + "[" * 500_000 + " x", bytes(10)


def _idl() -> Iterator[tuple[str, str, bytes]]:
    def inside(body: str) -> str:
        return f"module a {{ module msg {{ {body} }}; }};"

    typedefs = "".join(f"typedef T{i} T{i + 1}[60000];" for i in range(40))
    yield "typedefs of arrays", inside(f"typedef octet T0; {typedefs} struct T {{ T40 x; }};"), bytes(1000)
    yield "cycle of typedefs", inside("typedef B A; typedef A B; struct T { A x; };"), bytes(100)
    yield "cycle of structures", inside("struct A { sequence<T> t; }; struct T { sequence<A> a; };"), LONG * 1000
    yield "deep modules", "module a { " * 60_000, b""
    yield "deep sequences", inside("struct T { " + "sequence<" * 90_000 + "octet" + ">" * 90_000 + " x; };"), LONG
    yield (
        "many values",
        inside("enum E { " + ",".join(f"V{i}" for i in range(100_000)) + " }; struct T { E e; };"),
        bytes(9),
    )
    yield "many fields", inside("struct T { " + "".join(f"octet a{i};" for i in range(70_000)) + " };"), bytes(100_000)
    yield "a million fields", inside("struct T { " + "".join(f"octet a{i};" for i in range(10**6)) + " };"), bytes(9)
    yield "deep annotations", inside("@a(" * 200_000 + "struct T { octet x; };"), bytes(9)
    yield "constants of constants", inside("const long A = B; const long B = A; struct T { octet x[A]; };"), bytes(9)
    yield "comments that stay open", "/* " * 300_000, b""
    yield (
        "bounded by 2^32 - 1",
        inside(f"struct T {{ sequence<double, {MOST}> x; string<{MOST}> s; }};"),
        LONG + bytes(99),
    )


def _json() -> Iterator[tuple[str, str, bytes]]:
    deep, digits = "[" * 400_000 + "]" * 400_000, "9" * 4300
    for name, text in {
        "deep lists": deep,
        "deep objects": '{"a":' * 400_000 + "1" + "}" * 400_000,
        "a million keys": json.dumps({f"k{i}": i for i in range(1_000_000)}),
        "a million lists": "[" + "[]," * 1_000_000 + "[]]",
        "long integers": "[" + f"{digits}," * 300 + "1]",
        "one long integer": "9" * 2_000_000,
        "powers": "[" + "1e999999999," * 100_000 + "1]",
        "long keys": json.dumps({"k" * 100_000: {f"{i}": 0 for i in range(10_000)}}),
        "names of brackets": json.dumps({"[" * 1000 + str(i): {"." * 500: {"]": i}} for i in range(300)}),
        "half a character": '"' + "\\ud800" * 300_000 + '"',
        "a text without end": '{"a": "' + "x" * 2_000_000,
    }.items():
        yield name, "{}", text.encode()


def _file(name: str, *imports: str) -> descriptor_pb2.FileDescriptorProto:
    return descriptor_pb2.FileDescriptorProto(name=name, package="a", syntax="proto3", dependency=imports)


def _protobuf_files() -> Iterator[tuple[str, list[descriptor_pb2.FileDescriptorProto], bytes]]:
    itself = _file("a.proto")
    message = itself.message_type.add(name="T")
    message.field.add(name="t", number=1, type=11, label=1, type_name=".a.T")
    message.field.add(name="many", number=2, type=11, label=3, type_name=".a.T")
    message.field.add(name="x", number=3, type=1, label=3)
    yield "messages in messages", [itself], _nested(5000)
    yield "millions of empty messages", [itself], b"\x12\x00" * 500_000
    yield "a length of 2^32 - 1", [itself], b"\x0a\xff\xff\xff\xff\x0f" + bytes(100)
    yield "a length of 2^63", [itself], b"\x1a" + b"\xff" * 9 + b"\x01" + bytes(100)
    yield "lengths without end", [itself], b"\x0a" + b"\xff" * 1000
    wide = _file("a.proto")
    message = wide.message_type.add(name="T")
    for number in range(1, 40_001):
        message.field.add(name=f"x{number}", number=number, type=1, label=1)
    yield "many fields", [wide], b""
    chain = [_file(f"f{i}.proto", f"f{i + 1}.proto") for i in range(9000)]
    chain[0].message_type.add(name="T").field.add(name="x", number=1, type=1, label=1)
    yield "imports of imports", [*chain, _file("f9000.proto")], b"\x09" + bytes(8)
    yield "imports in a circle", [_file("a.proto", "b.proto"), _file("b.proto", "a.proto")], b""
    yield "an import of itself", [_file("a.proto", "a.proto")], b""
    fan = [_file(f"f{i}.proto", *(f"f{k}.proto" for k in range(max(i - 200, 0), i))) for i in range(300)]
    fan[-1].message_type.add(name="T").field.add(name="x", number=1, type=1, label=1)
    yield "imports of all", fan, b""
    tree = _file("a.proto")
    for i in range(5000):
        message = tree.message_type.add(name="T" if i == 0 else f"T{i}")
        for side in (1, 2):
            message.field.add(name=f"s{side}", number=side, type=11, label=1, type_name=f".a.T{min(i + 1, 4999)}")
    yield "a tree of types", [tree], b"\x0a\x00"
    values = _file("a.proto")
    kind = values.enum_type.add(name="E")
    for i in range(60_000):
        kind.value.add(name=f"V{i}", number=i)
    values.message_type.add(name="T").field.add(name="e", number=1, type=14, label=1, type_name=".a.E")
    yield "many values", [values], b"\x08\x01"


def _nested(depth: int) -> bytes:
    """A message within a message, and so on."""
    payload = b""
    for _ in range(depth):
        size, length = len(payload), b""
        while size > 127:
            length, size = length + bytes([size & 127 | 128]), size >> 7
        payload = b"\x0a" + length + bytes([size]) + payload
    return payload


def hostile(kind: str) -> Iterator[tuple[str, Topic, bytes]]:
    """Name, topic and message of each case of a kind of definitions."""
    if kind == "json":
        for name, text, body in _json():
            yield name, Topic("/t", "a", "json", "jsonschema", text.encode()), body
    elif kind == "protobuf":
        for name, files, body in _protobuf_files():
            schema = descriptor_pb2.FileDescriptorSet(file=files).SerializeToString()
            yield name, Topic("/t", "a.T", "protobuf", "protobuf", schema), body
    else:
        ros1 = kind == "ros1msg"
        for name, text, body in _idl() if kind == "ros2idl" else _ros():
            topic = Topic("/t", "a/msg/T", "ros1" if ros1 else "cdr", kind, text.encode())
            yield name, topic, body if ros1 else HEAD + body

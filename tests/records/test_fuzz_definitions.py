"""Definitions and messages that are damaged at random, by seed: a result, or the package's own error."""

import json
import random

import pytest
from palpate import LogError
from palpate_records.messages.decoders import decoder_of
from palpate_records.messages.topics import Topic

MSG = (
    'A[] items\nstring<=9 name "x"\nfloat64[3] p\nuint8 K=3\nB b\n'
    "====\nMSG: a/A\nB[2] b\nwstring w\n====\nMSG: a/B\nint8 x"
)
IDL = (
    "module a { module msg { const long N = 4; typedef double P[N]; enum E { X, Y };\n"
    '@verbatim (language="c", text="y") struct T { sequence<P2> s; P p; string<8> t; E e; octet o[2][3]; };\n'
    "struct P2 { @key float x, y; }; }; };"
)
JSON = json.dumps({"stamp": {"sec": 1, "nanosec": 2}, "name": ["a", 1, None], "x": [1.5, {"y": [[2], "z"]}], "t": "u"})
PIECES = ["[", "]", "{", "}", "<", "=", ";", '"', "'", "/*", "\\", "\n", "9" * 30, "²", "\0"]
PIECES += ["A[] a\n", "struct ", "::", "-1", "1e999", "====\n"]


def damaged(text, dice):
    """The text with a few pieces of it removed, doubled, or replaced."""
    for _ in range(dice.randint(1, 4)):
        begin = dice.randrange(len(text) + 1)
        end = min(begin + dice.choice([0, 1, 3, 20]), len(text))
        piece = dice.choice([dice.choice(PIECES) * dice.choice([1, 2, 500]), text[begin:end] * 2, ""])
        text = text[:begin] + piece + text[end:]
    return text


def outcome(encoding, schema_encoding, schema, payload):
    try:
        decoder = decoder_of(Topic("/t", "a/msg/T", encoding, schema_encoding, schema))
        return len(decoder.fields(payload)) + len(decoder.texts(payload)) + len(decoder.names(payload))
    except LogError:
        return None


@pytest.mark.parametrize(("schema_encoding", "text"), [("ros2msg", MSG), ("ros2idl", IDL)])
def test_damaged_definitions(schema_encoding, text):
    dice = random.Random(schema_encoding)
    found = set()
    for _ in range(400):
        payload = b"\0" + bytes([dice.randint(0, 4), 0, 0]) + bytes(dice.choices(range(4), k=dice.randint(0, 300)))
        found.add(outcome("cdr", schema_encoding, damaged(text, dice).encode("utf-8", "surrogatepass"), payload))
    assert None in found


def test_damaged_json():
    dice = random.Random("json")
    found = [outcome("json", "jsonschema", b"{}", damaged(JSON, dice).encode()) for _ in range(600)]
    assert None in found
    assert len(set(found)) > 5


def test_damaged_protobuf():
    from google.protobuf import descriptor_pb2

    file = descriptor_pb2.FileDescriptorProto(name="a.proto", package="a", syntax="proto3")
    message = file.message_type.add(name="T")
    for number, kind in enumerate((1, 5, 9, 12), 1):
        message.field.add(name=f"x{number}", number=number, type=kind, label=dict.fromkeys((1, 5), 3).get(kind, 1))
    message.field.add(name="inner", number=9, type=11, label=3, type_name=".a.T")
    schema = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
    dice = random.Random("protobuf")
    found = set()
    for _ in range(400):
        raw = bytearray(schema)
        for _ in range(dice.randint(0, 2)):
            raw[dice.randrange(len(raw))] = dice.randrange(256)
        payload = bytes(dice.choices([0, 1, 2, 8, 9, 10, 18, 26, 74, 255], k=dice.randint(0, 40)))
        try:
            decoder = decoder_of(Topic("/t", "a.T", "protobuf", "protobuf", bytes(raw)))
            found.add(len(decoder.fields(payload)))
        except LogError:
            found.add(None)
    assert None in found
    assert len(found) > 2

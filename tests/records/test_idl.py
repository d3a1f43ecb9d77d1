"""Message definitions as IDL: what rosidl writes, what people write, and what nobody can read."""

import struct

import numpy as np
import pytest
from mcap.writer import Writer
from palpate.errors import LogError
from palpate_devices.mcap_replay import McapReplay
from palpate_records.messages.definitions import Field, parse_definitions

# As rosidl writes them: comments, annotations, constants, typedefs of arrays, names of modules.
LOAD = """
// generated from rosidl_adapter/resource/msg.idl.em
// with input from lab_msgs/msg/Load.msg
#include "std_msgs/msg/Header.idl"
#include "lab_msgs/msg/Cell.idl"

module lab_msgs {
  module msg {
    typedef double double__6[6];
    typedef lab_msgs::msg::Cell lab_msgs__msg__Cell__2[2];
    module Load_Constants {
      const uint8 IDLE = 0;
      @verbatim (language="comment", text="a text with ( and ; in it" "and a second line")
      const string NAME = "load; cell";
    };
    @verbatim (language="comment", text=
      "Load of a cell.")
    struct Load {
      @verbatim (language="comment", text="when") @unit (value="s")
      std_msgs::msg::Header header;
      @default (value=1.5)
      double newtons;
      double__6 matrix;
      sequence<float, 4> few;
      sequence<lab_msgs::msg::Cell> cells;
      lab_msgs__msg__Cell__2 pair;
      boolean good;
      octet raw;
      string<8> word;
      unsigned long long count;
    };
  };
};
================================================================================
IDL: lab_msgs/msg/Cell
module lab_msgs { module msg {
  enum Kind { A, B };
  const long SIZE = 3;
  struct Cell { Kind kind; int16 gain, offset; /* two at once */ short trims[SIZE]; double grid[2][2]; };
}; };
"""
SAME = """
std_msgs/Header header
float64 newtons
float64[6] matrix
float32[<=4] few
Cell[] cells
Cell[2] pair
bool good
byte raw
string<=8 word
uint64 count
================================================================================
MSG: lab_msgs/Cell
uint32 kind
int16 gain
int16 offset
int16[3] trims
float64[4] grid
"""


def test_idl_says_what_a_msg_says():
    assert parse_definitions("lab_msgs/msg/Load", LOAD) == parse_definitions("lab_msgs/msg/Load", SAME)


def test_names_as_dds_has_them_are_those_of_ros():
    text = "module lab_msgs { module msg { module dds_ { struct Load_ { double newtons; }; }; }; };"
    assert parse_definitions("lab_msgs/msg/Load", text) == {"lab_msgs/Load": (Field("newtons", "float64"),)}


@pytest.mark.parametrize(
    ("body", "problem"),
    [
        ("struct Load { long double x; };", "'long double' is not a type"),
        ("struct Load { wchar x; };", "'wchar' is not a type"),
        ("struct Load { sequence<sequence<double>> x; };", "a sequence of sequences"),
        ("struct Load { double x[N]; };", "'N' is not a number of elements"),
        ("struct Load { double x };", "'}' where ';' is to be"),
        ("struct Load { double x; }", "'}' where ';' is to be"),
        ("struct Load : Base { double x; };", "derived"),
        ("union Load switch (long) { case 0: double x; };", "'union' is not a module"),
        ("struct Load { Cell x; };", "names lab_msgs/Cell"),
        ("struct Load { Load x; };", "contains itself"),
        ("struct Other { double x; };", "does not define lab_msgs/msg/Load .but lab_msgs/Other"),
        ("struct Load { double x;", "'the end' where|ends too early"),
        ("@verbatim (", "ends too early"),
    ],
)
def test_what_cannot_be_read_is_told(body, problem):
    with pytest.raises(LogError, match=problem):
        parse_definitions("lab_msgs/msg/Load", f"module lab_msgs {{ module msg {{ {body} }}; }};")


def test_a_log_whose_types_are_described_in_idl_is_read(tmp_path):
    path = tmp_path / "log.mcap"
    text = b"module lab_msgs { module msg { struct Load { float trim; double newtons; }; }; };"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("lab_msgs/msg/Load", "ros2idl", text)
        channel = writer.register_channel("/load", "cdr", schema)
        for i in range(20):
            payload = b"\0\1\0\0" + struct.pack("<fxxxxd", 0.5, i / 8)
            writer.add_message(channel, i, payload, i)
        writer.finish()
    signals = {"force": {"topic": "/load", "field": "newtons", "unit": "N"}}
    with McapReplay.model_validate({"file": path, "signals": signals, "time": "log"}).connect(0) as link:
        values = np.concatenate([batch.values[:, 0] for batch in link.batches()])
    assert values.tolist() == [i / 8 for i in range(20)]

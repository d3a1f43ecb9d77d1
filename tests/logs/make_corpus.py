"""Makes the files of `corpus`, each with one thing wrong that no reader must fall for; those that are there stay."""

import gzip
import io
import sqlite3
import struct
import sys
import zlib
from contextlib import closing
from pathlib import Path

import lz4.frame
import zstandard
from mcap.writer import CompressionType, Writer
from palpate_devices.messages import WRENCH

from tests.records.bags import array_message, wrench_message, write_bag

MAGIC = b"\x89MCAP0\r\n"
FOLDER = Path(__file__).parent / "corpus"
HEADER = b"\x01" + struct.pack("<QII", 8, 0, 0)
END = b"\x0f" + struct.pack("<QI", 4, 0) + b"\x02" + struct.pack("<QQQI", 20, 0, 0, 0) + MAGIC


def log(definition=WRENCH.definition, kind=WRENCH.name, payload=None, encoding="cdr", **options):
    """A whole log of forty messages of one topic."""
    file = io.BytesIO()
    writer = Writer(file, **{"chunk_size": 1024, "compression": CompressionType.NONE, **options})
    writer.start(profile="ros2", library="corpus")
    channel = writer.register_channel(
        "/ft/wrench", encoding, writer.register_schema(kind, "ros2msg", definition.encode())
    )
    for i in range(40):
        message = wrench_message(i, "tool0", [0, 0, i, 0, 0, 0]) if payload is None else payload
        writer.add_message(channel, i, message, i)
    writer.add_attachment(0, 0, "notes.txt", "text/plain", b"notes")
    writer.finish()
    return file.getvalue()


def records(raw):
    """Kind, offset and length of every record."""
    at = len(MAGIC)
    while at < len(raw) - len(MAGIC):
        length = struct.unpack_from("<Q", raw, at + 1)[0]
        yield raw[at], at, length
        at += 9 + length


def changed(raw, kind, offset, code, value, which=0):
    """With other bytes at an offset in the content of a record."""
    at = [begin for opcode, begin, _ in records(raw) if opcode == kind][which] + 9 + offset
    new = struct.pack(code, value)
    return raw[:at] + new + raw[at + len(new) :]


def chunk(name, packed, claimed, crc=0):
    body = struct.pack("<QQQII", 0, 1, claimed, crc, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    return MAGIC + HEADER + b"\x06" + struct.pack("<Q", len(body)) + body + END


def cyclic():
    line = "\n" + "=" * 80 + "\n"
    return f"lab/A a{line}MSG: lab/A\nlab/B b{line}MSG: lab/B\nlab/A a"


def databases():
    """Names, and what is done to the tables of a bag after they are filled, or instead of it."""
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS id, 1 AS topic_id, "
    yield (
        "endless_view.db3",
        "DROP TABLE messages; CREATE VIEW messages AS " + endless + "i AS timestamp, x'00' AS data FROM n;",
        "",
    )
    yield "topics_are_a_view.db3", "", "ALTER TABLE topics RENAME TO t; CREATE VIEW topics AS SELECT * FROM t;"
    yield (
        "computed_column.db3",
        "ALTER TABLE messages ADD COLUMN seconds AS (timestamp / 1e9);"
        "ALTER TABLE topics ADD COLUMN short AS (substr(name, 2));",
        "",
    )
    yield (
        "index_of_words.db3",
        "",
        "CREATE VIRTUAL TABLE words USING fts5(note); INSERT INTO words VALUES ('soft'), ('hard');"
        "CREATE TABLE notes(a, b UNIQUE, c AS (a || b)); INSERT INTO notes VALUES (1, 2);",
    )


def database(before, after):
    """A bag of 200 messages."""
    path = FOLDER / "whole.db3"
    write_bag(path, [("/data", "std_msgs/msg/Float64MultiArray", [(i, array_message([i, i])) for i in range(200)])])
    with closing(sqlite3.connect(path)) as opened:
        rows = opened.execute("SELECT id, topic_id, timestamp, data FROM messages").fetchall()
        if before:
            opened.executescript(before)
        if "DROP" not in before:
            opened.execute("DELETE FROM messages")
            opened.executemany("INSERT INTO messages(id, topic_id, timestamp, data) VALUES (?, ?, ?, ?)", rows)
        opened.commit()
        opened.executescript(after)
        opened.execute("VACUUM")
    raw = path.read_bytes()
    path.unlink()
    return raw


def files():
    """Bytes by name."""
    whole, zeros = log(), bytes(1 << 24)
    packed = zstandard.ZstdCompressor().compress(zeros)
    lots = zstandard.ZstdCompressor().compress(b"".join([packed] * 40))
    yield "placeholder_chunk.mcap", changed(whole, 6, -8, "<Q", 2**64 - 1, which=1)
    yield "message_longer_than_its_chunk.mcap", changed(log(enable_crcs=False), 6, 41, "<Q", 2**63)
    yield "chunk_claims_100_gb.mcap", chunk(b"zstd", packed[:200], 10**11)
    yield "zstd_bomb.mcap", chunk(b"zstd", packed, 1000)
    yield "zstd_bomb_in_a_bomb.mcap", chunk(b"zstd", lots, 1 << 27)
    yield "lz4_bomb.mcap", chunk(b"lz4", lz4.frame.compress(zeros[: 1 << 21]), 1000)
    yield "chunk_size_too_small.mcap", chunk(b"", zeros[:64], 10, zlib.crc32(zeros[:64]))
    yield "checksum_wrong.mcap", changed(whole, 6, 24, "<I", 1)
    yield "index_points_nowhere.mcap", changed(whole, 7, 6 + 8, "<Q", 2**64 - 1)
    yield "index_points_into_a_message.mcap", changed(whole, 7, 6 + 8, "<Q", 5)
    yield "index_claims_too_many.mcap", changed(whole, 7, 2, "<I", 2**32 - 1)
    yield "statistics_lie.mcap", changed(log(enable_crcs=False), 11, 0, "<Q", 7)
    yield "chunk_index_beyond_the_end.mcap", changed(log(enable_crcs=False), 8, 16, "<Q", 2**62)
    yield "summary_begins_nowhere.mcap", changed(whole, 2, 0, "<Q", 2**64 - 1)
    yield "attachment_without_end.mcap", changed(whole, 9, 16, "<I", 2**32 - 1)
    yield "channel_of_no_schema.mcap", changed(log(use_chunking=False, enable_crcs=False), 4, 2, "<H", 77)
    yield "topic_name_without_end.mcap", changed(log(use_chunking=False), 4, 4, "<I", 2**32 - 1)
    yield "definition_is_cyclic.mcap", log(cyclic(), "lab/msg/Loop")
    yield "definition_is_garbage.mcap", log("\x00\x07 no [definition", "lab/msg/Garbage")
    yield "definition_is_of_another_type.mcap", log("float64[<=3] x\nstring words", "lab/msg/Other")
    yield "sequence_of_four_billion.mcap", log("float64[] x", "lab/msg/Many", b"\0\1\0\0\xff\xff\xff\xff")
    yield "message_of_no_bytes.mcap", log(payload=b"")
    yield "message_is_no_json.mcap", log(payload=b"[" * 2000, encoding="json", compression=CompressionType.ZSTD)
    yield "no_end.mcap", whole[: len(whole) // 2]
    yield "only_a_head.mcap", whole[:9]
    path = FOLDER / "whole.db3"
    write_bag(path, [("/data", "std_msgs/msg/Float64MultiArray", [(i, array_message([i, i])) for i in range(200)])])
    bag = path.read_bytes()
    path.unlink()
    yield "cut.db3", bag[: len(bag) // 2]
    yield "pages_of_noise.db3", bag[:8192] + b"\xa5" * 4096 + bag[12288:]
    yield "no_pages.db3", bag[:100]
    yield "text.db3", b"this is a letter, and no database\n" * 10
    yield "bomb.db3.gz", gzip.compress(zeros, mtime=0)
    yield "name_of_no_text.db3", bag.replace(b"/data", b"/\xff\xfe\xb1a")
    yield "schema_of_no_text.db3", bag.replace(b"TABLE messages(", b"TABLE mess\xff\xfe\xb1(")
    for name, before, after in databases():
        yield name, database(before, after)
    packed = bytearray(gzip.compress(b"0.1,0.2,0.3\n" * 4000, mtime=0))
    packed[40:60] = bytes(20)
    yield "damaged.csv.gz", bytes(packed)
    packed = bytearray(gzip.compress(bag, mtime=0))
    packed[400:440] = bytes(40)
    yield "damaged.db3.gz", bytes(packed)
    zeros = b"SQLite format 3\0" + bytes(1 << 27)
    yield "bomb_that_begins_well.db3.zstd", zstandard.ZstdCompressor().compress(zeros)
    yield (
        "spike.csv",
        b"time_s,force_N,z_m\n"
        + b"".join(
            b"%.3f,%s,%.4f\n" % (i / 500, b"1e155" if i == 200 else b"%.2f" % (i % 7), i / 1e4) for i in range(400)
        ),
    )
    yield "brackets.csv", b"[" * 80_000 + b",z_m\n1,2\n"
    yield "underscores.csv", b"t,force_N,z_m\n0.001,1_5,0.1\n0.002,2,0.2\n"
    yield "one_cell_too_many.csv", b"0.001,1,0.1\n" * 30 + b"0.002,7,1,0.1\n" + b"0.003,1,0.1\n" * 30
    yield (
        "times_of_no_number.csv",
        b"t,force_N,z_m\n"
        + b"".join(b"%s,1,0.1\n" % (b"inf" if i % 5 == 0 else b"nan" if i % 7 == 0 else b"%d" % i) for i in range(100)),
    )
    rows = b"".join(b"%.3f,%.2f,%.4f\n" % (i / 500, i % 7, i / 1e4) for i in range(400))
    yield "cut_within_its_last_number.csv", (b"time_s,force_N,z_m\n" + rows)[:-4]
    yield "no_last_end_of_line.csv", (b"time_s,force_N,z_m\n" + rows)[:-1]
    yield "commas.csv", b"t;z\n0,1;1,5\n0,2;1,6\n"
    yield "ragged.csv", b"t,force_N,z_m\n0.1,1\n0.2,1,2,3,4\n\n,,\n"
    yield "bytes.csv", bytes(range(256))
    yield "bomb.csv.gz", gzip.compress(zeros, mtime=0)


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, raw in files():
        if "--all" in sys.argv or not (FOLDER / name).exists():
            (FOLDER / name).write_bytes(raw)

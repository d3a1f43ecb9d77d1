"""The index of a log that is being written lies on disk, and changes no byte of the log."""

import io
import tracemalloc

import pytest
from mcap.writer import Writer
from palpate_devices.mcap_index import Index, keep_index_in


def written(chunks, index=None):
    file = io.BytesIO()
    writer = Writer(file)
    if index is not None:
        keep_index_in(writer, index)
    writer.start(profile="ros2", library="test")
    schema = writer.register_schema("numbers", "ros2msg", b"float64 x")
    channels = [writer.register_channel(f"/{i}", "cdr", schema) for i in range(10)]
    for chunk in range(chunks):
        for channel in channels:
            writer.add_message(channel, log_time=chunk, data=b"12345678", publish_time=chunk)
        writer.flush()
    return file, writer


def test_the_log_is_the_same_to_the_byte():
    (plain, one), (kept, two) = written(50), written(50, io.BytesIO())
    one.finish()
    two.finish()
    assert plain.getvalue() == kept.getvalue()


def test_the_library_s_writer_keeps_its_index_where_we_look_for_it():
    _, writer = written(3, io.BytesIO())
    assert isinstance(writer._Writer__chunk_indices, Index)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_chunks(tmp_path):
    def growth(index):
        tracemalloc.start()
        kept = written(2000, index)
        file_size = kept[0].getbuffer().nbytes
        size = tracemalloc.get_traced_memory()[0] - file_size
        tracemalloc.stop()
        return size

    with (tmp_path / "index").open("w+b") as file:
        on_disk = growth(file)
    assert on_disk < growth(None) - 2000 * 500

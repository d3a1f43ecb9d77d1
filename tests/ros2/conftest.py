"""A publisher and a subscriber that are not ours: Fast DDS in C++, built where its library is."""

import contextlib
import hashlib
import itertools
import os
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import pytest
from palpate_records.messages.standard_types import STANDARD_TYPES

_numbers = itertools.count()


def built(name):
    """A program; skips, and says why, where it cannot be built."""
    source = Path(__file__).with_name(f"{name}.cpp")
    if shutil.which("g++") is None or not Path("/usr/include/fastdds").is_dir():
        pytest.skip("needs Fast DDS in C++ as the other end: apt install g++ libfastrtps-dev")
    name = f"palpate-ros2-{name}-{hashlib.sha256(source.read_bytes()).hexdigest()[:16]}"
    program = Path(tempfile.gettempdir()) / name
    if not program.exists():  # some seconds, once for a machine
        fresh = program.with_suffix(f".{os.getpid()}")
        command = ["g++", "-std=c++17", str(source), "-o", str(fresh), "-lfastrtps", "-lfastcdr", "-lpthread"]
        subprocess.run(command, check=True, capture_output=True)
        fresh.rename(program)
    return program


@pytest.fixture
def domain():
    """A domain of this test alone."""
    pytest.importorskip("cyclonedds")
    return 1 + (os.getpid() * 7 + next(_numbers)) % 220


@pytest.fixture
def publish(tmp_path, domain):
    """Starts a publisher of lines, or of a recorded run's bytes; all that were started are killed in the end."""
    program = built("publisher")
    with contextlib.ExitStack() as stack:

        def start(lines, offset=0.0, times=1, **environment):
            table = tmp_path / f"table{next(_numbers)}"
            table.write_bytes(lines if isinstance(lines, bytes) else ("\n".join(lines) + "\n").encode())
            command = [str(program), str(domain), str(table), str(offset), str(times)]
            process = subprocess.Popen(command, stdout=subprocess.DEVNULL, env={**os.environ, **environment})
            stack.callback(process.wait)
            stack.callback(process.kill)
            return process

        yield start


@pytest.fixture
def subscribe(tmp_path, domain):
    """Starts a subscriber of topics; what it returns ends it, and gives the parts of each message it was sent."""
    program = built("subscriber")
    with contextlib.ExitStack() as stack:

        def start(*topics):
            command = [str(program), str(domain), "60", *topics]
            heard = tmp_path / f"heard{next(_numbers)}"  # a pipe that nobody empties would hold it up
            with heard.open("w") as file:
                process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=file, text=True)
            stack.callback(process.wait)
            stack.callback(process.kill)
            while not heard.read_text().startswith("ready\n"):
                assert process.poll() is None
                time.sleep(0.01)

            def end():
                process.communicate("\n")
                return [line.split("\t") for line in heard.read_text().splitlines()[1:]]

            return end

        yield start


@pytest.fixture
def decoded():
    """Reads a message by a library that is not ours: of a type and its bytes."""
    from mcap_ros2._dynamic import generate_dynamic

    def full(plain, package):
        names = (plain, f"std_msgs/{plain}", f"{package}/{plain}", f"geometry_msgs/{plain}")
        return next((name for name in names if name in STANDARD_TYPES), None)

    def definition(kind, needed):
        lines = []
        for line in STANDARD_TYPES[kind].splitlines():
            base, _, field = line.partition(" ")
            found = full(base.removesuffix("[]"), kind.split("/")[0])
            if found and found not in needed:
                needed.append(found)
            lines.append(f"{found or base.removesuffix('[]')}{'[]' if base.endswith('[]') else ''} {field}")
        return "\n".join(lines)

    def decode(name, payload):
        needed = [name.replace("/msg/", "/")]
        texts = [definition(needed[0], needed)]
        texts += [f"MSG: {kind}\n{definition(kind, needed)}" for kind in needed[1:]]
        for kind in needed[len(texts) :]:
            texts.append(f"MSG: {kind}\n{definition(kind, needed)}")
        return generate_dynamic(needed[0], f"\n{'=' * 80}\n".join(texts))[needed[0]](payload)

    return decode

"""A publisher as rmw_zenoh has them, by eclipse-zenoh and its own CDR: what palpate's device is tested against.

usage: python zenoh_publisher.py PORT DOMAIN TABLE [OFFSET]

It imports nothing of palpate. TABLE is a JSON list of topics: name, type by its name in DDS, hash, qos, messages
[[seconds, hexadecimal], ...], `stamped` (whether seconds and nanoseconds of the header are set at sending). It listens
at tcp/127.0.0.1:PORT, or, with a port below 0, is a node as rmw_zenoh configures it, that knows a router at -PORT. It
says `ready` once its topics can be found, waits for a subscriber of every one, sends each message at its time, and
stays until its input ends.
"""

import json
import struct
import sys
import time

import zenoh
import zenoh.ext


def main():
    port, domain, table = sys.argv[1:4]
    offset = float(sys.argv[4]) if len(sys.argv) > 4 else 0.0
    with open(table) as file:
        topics = json.load(file)
    config = zenoh.Config()
    settings = {
        "mode": "peer",
        "listen/endpoints": ["tcp/localhost:0" if port.startswith("-") else f"tcp/127.0.0.1:{port}"],
        "connect/endpoints": [f"tcp/127.0.0.1:{port[1:]}"] if port.startswith("-") else [],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session:
        kept, events = [], []
        node = f"@ros2_lv/{domain}/{session.zid()}/0"
        kept.append(session.liveliness().declare_token(f"{node}/0/NN/%/%/driver"))
        for k, topic in enumerate(topics):
            kind = f"{topic['type']}/{topic['hash']}"
            mangled = topic["name"].replace("/", "%")
            token = f"{node}/{k + 1}/MP/%/%/driver/{mangled}/{kind}/{topic['qos']}"
            kept.append(session.liveliness().declare_token(token))
            writer = session.declare_publisher(f"{domain}/{topic['name'].strip('/')}/{kind}")
            who = struct.pack("<QQ", hash(token) & (2**64 - 1), k)
            events += [(at, k, writer, who, topic["stamped"], bytes.fromhex(raw)) for at, raw in topic["messages"]]
        print("ready", flush=True)
        writers = list({id(event[2]): event[2] for event in events}.values())
        while not all(writer.matching_status.matching for writer in writers):
            time.sleep(0.002)
        began, wall = time.monotonic_ns(), time.time_ns()
        for number, (at, _, writer, who, stamped, message) in enumerate(sorted(events, key=lambda e: e[:2])):
            time.sleep(max(0.0, (began + 1e9 * at - time.monotonic_ns()) / 1e9))
            now = wall + round(1e9 * (at + offset))
            if stamped:
                message = message[:4] + struct.pack("<iI", now // 10**9, now % 10**9) + message[12:]
            extra = struct.pack("<qqB", number + 1, now, 16) + who
            writer.put(message, attachment=extra)
        sys.stdin.read()


if __name__ == "__main__":
    main()

"""Decodes every message of MCAP files twice and compares; see check_recording.sh."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader


def leaves(value: Any, store: Any = None, path: str = "") -> Iterator[tuple[str, Any]]:
    """Path and value of everything in a message of either decoder, or in dictionaries and lists, that has no
    parts. A float is given as the text that stands for its bits: the two zeros differ, nan is nan."""
    if isinstance(value, numpy.ndarray):
        value = value.tolist()
    if isinstance(value, (bytes, bytearray, memoryview)):
        value = list(value)
    if hasattr(value, "__msgtype__"):
        # rosbags: constants of a definition are attributes, but no fields.
        _, fields = store.fielddefs[value.__msgtype__]
        value = {name: getattr(value, name) for name, _ in fields}
    elif hasattr(value, "__slots__"):
        value = {name: getattr(value, name) for name in value.__slots__}
    if isinstance(value, dict):
        for name, item in value.items():
            yield from leaves(item, store, f"{path}.{name}")
    elif isinstance(value, (list, tuple)):
        for i, item in enumerate(value):
            yield from leaves(item, store, f"{path}[{i}]")
        yield path + ".length", len(value)
    else:
        yield path, float.__repr__(value) if isinstance(value, float) else value


def messages(path: str | Path) -> Iterator[tuple[str, int, Any, dict[str, Any]]]:
    """Topic, time (ns), message and its leaves of everything in a file. Each package opens the file on its
    own; that both see the same, and ROS 2's encoding everywhere, is asserted."""
    with open(path, "rb") as file, AnyReader([Path(path)]) as bag:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        pairs = zip(reader.iter_decoded_messages(), bag.messages(), strict=True)
        for (schema, channel, message, decoded), (connection, time_ns, raw) in pairs:
            assert schema and (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg"), channel
            where = (channel.topic, schema.name, message.log_time)
            assert where == (connection.topic, connection.msgtype, time_ns)
            other = bag.deserialize(raw, connection.msgtype)
            a, b = dict(leaves(decoded)), dict(leaves(other, bag.typestore))
            assert a and a.keys() == b.keys(), (where, a.keys() ^ b.keys())
            for key in a:
                assert a[key] == b[key], (where, key, a[key], b[key])
            if hasattr(decoded, "header"):
                stamp = decoded.header.stamp
                assert stamp.sec * 10**9 + stamp.nanosec == time_ns, where
            yield channel.topic, time_ns, decoded, a


def check(path: str) -> None:
    counts: dict[str, int] = {}
    poses: dict[tuple[str, int], Any] = {}
    for topic, time_ns, message, _ in messages(path):
        counts[topic] = counts.get(topic, 0) + 1
        if topic.endswith("/pose"):
            poses[topic.split("/")[1], time_ns] = message.pose.position
        if topic == "/ballast/step":
            # A sleeper is where the request has it at the end of the window.
            for motion in message.request.motions:
                if motion.body.startswith("sleeper"):
                    seen, asked = poses[motion.body, time_ns], motion.knots[-1].pose.position
                    assert (seen.x, seen.y, seen.z) == (asked.x, asked.y, asked.z), motion
    assert counts, "no messages"
    print(f"{path}: {sum(counts.values())} messages on {len(counts)} topics, both decoders agree")


if __name__ == "__main__":
    for name in sys.argv[1:]:
        check(name)

"""Decodes every message of MCAP files twice and compares; see check_recording.sh."""

import sys

import numpy
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


def leaves(value, store, path=""):
    """Path and value of everything in a message of either decoder that is not a message itself."""
    if isinstance(value, numpy.ndarray):
        value = value.tolist()
    if isinstance(value, (bytes, bytearray, memoryview)):
        value = list(value)
    if isinstance(value, (list, tuple)):
        for i, item in enumerate(value):
            yield from leaves(item, store, f"{path}[{i}]")
        yield path + ".length", len(value)
    elif hasattr(value, "__msgtype__"):
        # rosbags: constants of a definition are attributes, but no fields.
        _, fields = store.fielddefs[value.__msgtype__]
        for name, _ in fields:
            yield from leaves(getattr(value, name), store, f"{path}.{name}")
    elif hasattr(value, "__slots__"):
        for name in value.__slots__:
            yield from leaves(getattr(value, name), store, f"{path}.{name}")
    else:
        yield path, value


def check(path):
    store = get_typestore(Stores.EMPTY)
    known, counts, poses = set(), {}, {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert (channel.message_encoding, schema.encoding) == ("cdr", "ros2msg"), channel
            if schema.name not in known:
                known.add(schema.name)
                types = get_types_from_msg(schema.data.decode(), schema.name)
                store.register({k: v for k, v in types.items() if k not in store.fielddefs})
            other = store.deserialize_cdr(message.data, schema.name)
            a, b = dict(leaves(decoded, store)), dict(leaves(other, store))
            assert a and a.keys() == b.keys(), (channel.topic, a.keys() ^ b.keys())
            for key in a:
                same = a[key] == b[key] or (a[key] != a[key] and b[key] != b[key])
                assert same, (channel.topic, message.log_time, key, a[key], b[key])
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if hasattr(decoded, "header"):
                stamp = decoded.header.stamp
                assert stamp.sec * 10**9 + stamp.nanosec == message.log_time, channel.topic
            if channel.topic.endswith("/pose"):
                poses[channel.topic.split("/")[1], message.log_time] = decoded.pose.position
            if channel.topic == "/ballast/step":
                # A sleeper is where the request has it at the end of the window.
                for motion in decoded.request.motions:
                    if motion.body.startswith("sleeper"):
                        seen = poses[motion.body, message.log_time]
                        asked = motion.knots[-1].pose.position
                        assert (seen.x, seen.y, seen.z) == (asked.x, asked.y, asked.z), motion
    assert counts, "no messages"
    print(f"{path}: {sum(counts.values())} messages on {len(counts)} topics, both decoders agree")


for name in sys.argv[1:]:
    check(name)

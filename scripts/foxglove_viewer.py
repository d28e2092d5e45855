"""Client of a live view for Foxglove (`ballast serve --foxglove ADDRESS`), for tests and measurements.

    python scripts/foxglove_viewer.py ws://127.0.0.1:8765 [SECONDS]

subscribes to everything and prints the number and size of the messages of each topic.
"""

import json
import struct
import sys
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any

import websocket
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

SUBPROTOCOL = "foxglove.sdk.v1"
#: Kinds of binary messages.
MESSAGE_DATA, TIME = 1, 2


@dataclass
class LiveMessage:
    """Message of a topic with its simulated time, ns, and its content in CDR."""

    topic: str
    time_ns: int
    data: bytes


class FoxgloveViewer:
    """Viewer that reads messages when asked to, and decodes them by the definitions that the server sends."""

    def __init__(self, url: str, timeout_s: float = 20.0, **options: Any) -> None:
        self.socket = websocket.create_connection(url, subprotocols=[SUBPROTOCOL], timeout=timeout_s, **options)
        #: Last `serverInfo`, and offered channels by topic.
        self.info: dict[str, Any] = {}
        self.channels: dict[str, dict[str, Any]] = {}
        #: Last simulated time that the server has sent, ns.
        self.now_ns = -1
        self._subscribed: dict[int, str] = {}
        self._decoders = DecoderFactory()

    def __enter__(self) -> "FoxgloveViewer":
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def subscribe(self, *topics: str) -> None:
        """Subscribes to topics, by default to all that are offered; those that it has already are left out."""
        new = [self.channels[topic] for topic in topics or self.channels if topic not in self._subscribed.values()]
        if not new:
            return
        self._subscribed.update((channel["id"], channel["topic"]) for channel in new)
        wanted = [{"id": channel["id"], "channelId": channel["id"]} for channel in new]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def read(self) -> LiveMessage | None:
        """Waits for a message; returns it if it belongs to a topic."""
        kind, data = self.socket.recv_data()
        if kind == websocket.ABNF.OPCODE_CLOSE:
            raise ConnectionResetError("live view: the server has closed the connection")
        if kind == websocket.ABNF.OPCODE_TEXT:
            said = json.loads(data)
            if said["op"] == "serverInfo":
                self.info = said
            elif said["op"] == "advertise":
                self.channels.update((channel["topic"], channel) for channel in said["channels"])
        elif data[0] == TIME:
            (self.now_ns,) = struct.unpack_from("<Q", data, 1)
        elif data[0] == MESSAGE_DATA:
            subscription, time_ns = struct.unpack_from("<IQ", data, 1)
            return LiveMessage(self._subscribed[subscription], time_ns, data[13:])
        return None

    def decode(self, message: LiveMessage) -> Any:
        """Decodes the content of a message."""
        channel = self.channels[message.topic]
        schema = Schema(channel["id"], channel["schema"].encode(), channel["schemaEncoding"], channel["schemaName"])
        decoder = self._decoders.decoder_for(channel["encoding"], schema)
        assert decoder is not None, channel
        return decoder(message.data)


def main() -> None:
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
    count, size = Counter[str](), Counter[str]()
    with FoxgloveViewer(sys.argv[1]) as viewer:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            message = viewer.read()
            viewer.subscribe()
            if message:
                count[message.topic] += 1
                size[message.topic] += len(message.data)
    for topic in sorted(count):
        print(f"{topic:40} {count[topic] / seconds:8.1f} 1/s {size[topic] / seconds * 1e-6:10.3f} MB/s")


if __name__ == "__main__":
    main()

"""Live view for Foxglove: a viewer decodes by the definitions that it receives, and sees what the simulation computes."""

from __future__ import annotations

import signal
import socket
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import ballast
import numpy as np
import pytest
from test_remote import KEY, Served, down

for package in ("websocket", "mcap_ros2", "scipy"):
    pytest.importorskip(package)

import websocket
from foxglove_viewer import FoxgloveViewer, LiveMessage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial.transform import Rotation


class ServedLive(Served):
    """A component with a live view."""

    def start(self, *more: str) -> None:
        # Windows that are not written are fast.
        self.command[self.command.index("--checkpoint-interval") + 1] = "100"
        super().start("--foxglove", "0", *more)

    def view(self, **options: Any) -> FoxgloveViewer:
        return FoxgloveViewer(self.events["serving"]["foxglove"], **options)


@pytest.fixture
def live(beds: Path, tmp_path: Path) -> Iterator[ServedLive]:
    live = ServedLive(beds, tmp_path / "serve")
    yield live
    live.end()


def wait(viewer: FoxgloveViewer, topic: str, fits: Callable[[LiveMessage], bool] = lambda _: True) -> Any:
    """Reads on until a message of a topic fits, and returns its content."""
    while True:
        viewer.subscribe()
        message = viewer.read()
        if message and message.topic == topic and fits(message):
            return viewer.decode(message)


def wait_for_time(viewer: FoxgloveViewer, time_ns: int) -> None:
    """Reads on until the server has sent this time, which has no order with messages of topics."""
    while viewer.now_ns != time_ns:
        viewer.read()


def has_grains(viewer: FoxgloveViewer, time_ns: int) -> Callable[[LiveMessage], bool]:
    """Accepts scenes of a time with the polyhedra of all stones."""
    return lambda scene: scene.time_ns == time_ns and viewer.decode(scene).entities[0].id == "grains"


def xyz(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def solids(triangles: Any) -> tuple[int, Any]:
    """Returns the number of connected surfaces, and for each corner the number of its surface."""
    a, b, c = np.reshape(triangles.indices, (-1, 3)).T
    edges, n = (np.concatenate([a, b]), np.concatenate([b, c])), len(triangles.points)
    return connected_components(coo_array((np.ones(len(edges[0])), edges), shape=(n, n)), directed=False)


def test_viewers_see_stones_tools_and_forces_of_the_last_window(
    live: ServedLive, sim: ballast.Simulation
) -> None:
    with live.open() as remote:
        for _ in range(4):
            motions = down(sim, 4e-3, 5)
            remote.advance_to(sim.now_ns + 5 * sim.step_ns, motions)
            result = sim.advance_to(sim.now_ns + 5 * sim.step_ns, motions)
        # It has connected after the last window, and sees it nevertheless.
        with live.view() as viewer:
            cloud = wait(viewer, "/stones", lambda message: message.time_ns == sim.now_ns)
            scene = wait(viewer, "/scene", has_grains(viewer, sim.now_ns))
            assert viewer.info["name"] == KEY and viewer.info["capabilities"] == ["time"]
            wait_for_time(viewer, sim.now_ns)
            shown = {entity.id: entity for entity in scene.entities}
            tracked = [name for name, role in sim.roles.items() if role != "boundary"]
            assert sorted(shown) == sorted(["grains", *tracked])
            [stones] = shown["grains"].triangles
            number, solid = solids(stones)
            assert number == sim.grain_count
            corners, first, state = np.array([xyz(point) for point in stones.points]), 0, sim.save()
            for i, (position, turn) in enumerate(zip(state.positions, state.orientations, strict=True)):
                shape = sim.shape(sim.shape_indices[i])[0]
                own = slice(first, first := first + len(shape))
                np.testing.assert_allclose(corners[own], Rotation.from_quat(turn).apply(shape.copy()) + position, atol=1e-12)
                assert len(set(solid[own])) == 1
            assert first == len(corners)
            for name in tracked:
                force = result[name].moving_average_force
                arrows = shown[name].arrows
                assert len(arrows) == bool(np.any(force))
                for arrow in arrows:
                    q, length = arrow.pose.orientation, arrow.shaft_length + arrow.head_length
                    along = [1 - 2 * (q.y**2 + q.z**2), 2 * (q.x * q.y + q.w * q.z), 2 * (q.x * q.z - q.w * q.y)]
                    # 0.2 m for 10 kN, at most 1 m.
                    expected = min(2e-5, 1.0 / float(np.linalg.norm(force))) * force
                    np.testing.assert_allclose(length * np.array(along), expected, rtol=1e-6, atol=1e-9)
            assert any(shown[name].arrows for name in tracked if name.startswith("tine"))
            points = np.frombuffer(bytes(cloud.data), "<f4").reshape(-1, 5)
            np.testing.assert_array_equal(points[:, :3], state.positions.astype(np.float32))
            # Those of the next window are decoded as they come.
            motions = down(sim, 1e-3, 2)
            remote.advance_to(sim.now_ns + 2 * sim.step_ns, motions)
            result = sim.advance_to(sim.now_ns + 2 * sim.step_ns, motions)
            wrench = wait(viewer, "/tine_1_plus/wrench", lambda message: message.time_ns == sim.now_ns)
            assert xyz(wrench.wrench.force) == list(result["tine_1_plus"].mean_force)
            assert wait(viewer, "/ballast/solver").iterations == result.solver.iterations


def test_viewers_start_again_when_a_state_is_restored(live: ServedLive) -> None:
    with live.open() as sim, live.view() as viewer:
        start = sim.save()
        sim.advance_to(5 * sim.step_ns)
        wait(viewer, "/tf", lambda message: message.time_ns == 5 * sim.step_ns)
        session = viewer.info["sessionId"]
        sim.restore(start)
        frames = wait(viewer, "/tf", lambda message: message.time_ns == 0).transforms
        assert "tine_1_plus" in [frame.child_frame_id for frame in frames]
        wait(viewer, "/scene", has_grains(viewer, 0))
        wait_for_time(viewer, 0)
        assert viewer.info["sessionId"] != session


def test_a_viewer_that_stops_reading_costs_nothing(live: ServedLive, sim: ballast.Simulation) -> None:
    # Small buffers are full after some windows.
    sockopt = [(socket.IPPROTO_TCP, socket.TCP_MAXSEG, 536), (socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)]
    last_ns = -1
    with live.open() as remote, live.view(sockopt=sockopt) as viewer:
        wait(viewer, "/clock")
        end = time.monotonic() + 0.7
        while time.monotonic() < end:
            remote.advance_to(remote.now_ns + sim.step_ns)
        sim.advance_to(remote.now_ns)
        assert remote.save().hash == sim.save().hash
        live.process.send_signal(signal.SIGINT)
        # It does not wait for the viewer either.
        assert live.process.wait(10.0) == 130
        viewer.socket.sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        with pytest.raises((ConnectionError, websocket.WebSocketException)):
            while True:
                message = viewer.read()
                last_ns = message.time_ns if message else last_ns
    # Buffers were full, so that the last window was not sent: it is sent at once to a viewer that reads.
    assert 0 <= last_ns < sim.now_ns

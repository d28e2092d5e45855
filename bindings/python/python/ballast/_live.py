"""Live view of a simulation with Rerun; `ballast.view.live` creates it."""

from __future__ import annotations

import importlib
import importlib.util
import math
import os
import queue
import sys
import threading
import time
import uuid
import warnings
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

import numpy as np

import ballast

#: Timeline of all values, s since the start of the run.
TIMELINE = "simulated_time"
#: Length of a force arrow, m per N: 10 kN are 0.2 m, as in the scenes of recordings.
METRES_PER_NEWTON = 2e-5
MAX_ARROW_LENGTH = 1.0
#: Radius of an arrow; negative radii are in pixels of the viewer.
ARROW_RADIUS = -3.0
#: Number of windows whose values wait for a viewer that does not read.
MAX_WAITING_WINDOWS = 10_000
#: Time that a viewer gets for the last frames, s.
CLOSE_TIMEOUT_S = 3.0
INSTALL = "expected the package rerun-sdk, found none; install it: pip install 'ballast[rerun]'"
STONE, SLEEPER, TINE, FORCE = (158, 148, 133), (191, 191, 184), (217, 89, 38), (26, 115, 230)
#: Colours of the lines in a plot, in turn (those of Okabe and Ito without black).
LINES = [(230, 159, 0), (86, 180, 233), (0, 158, 115), (240, 228, 66), (0, 114, 178), (213, 94, 0), (204, 121, 167)]


@dataclass(frozen=True)
class _Frame:
    """Values of one time, shared with the simulation and not copied."""

    time_ns: int
    state: ballast.State | None
    #: Position and orientation by body.
    poses: dict[str, tuple[Any, Any]]
    #: Force of the ballast by body, N.
    forces: dict[str, Any]
    #: Times and scalars of all windows since the last frame.
    windows: list[tuple[int, dict[str, float]]]


class LiveView:
    """Live view of a simulation, created by `live`.

    It shows each stone, tool and sleeper, the force of the ballast on tools and sleepers as arrows at their tops, where
    stones do not hide them (mean over 4 ms, 0.2 m for 10 kN, at most 1 m), and over simulated time: these forces (N),
    compactness of zones, kinetic energy (J), iterations per step, residual (QM/16) and largest penetration (m). Of a remote
    simulation it shows tools and sleepers as axes.

    A thread sends the frames. The simulation never waits for a viewer: frames that the viewer does not take are dropped,
    and a warning at the end has their number. A file gets every frame.

    Attributes:
        frames: number of frames that were given to the viewer or file.
        dropped_frames: number of frames that the viewer did not take in time.
    """

    def __init__(
        self, sim: ballast.Simulation, recording: Any, *, waits: bool, period_s: float, max_fps: float, zones: bool
    ) -> None:
        self.frames = 0
        self.dropped_frames = 0
        self._sim, self._recording, self._waits, self._zones = sim, recording, waits, zones
        self._period_ns, self._pause_s = round(period_s * 1e9), 1.0 / max_fps
        self._tracked = [name for name, role in sim.roles.items() if role != "boundary"]
        self._is_remote = _is_remote(sim)
        self._windows: deque[tuple[int, dict[str, float]]] = deque(maxlen=MAX_WAITING_WINDOWS)
        self._seen: ballast.WindowResult | None = None
        self._shown: ballast.WindowResult | None = None
        self._shown_ns: int | None = None
        self._shown_s = -math.inf
        self._failure: BaseException | None = None
        self._is_closing = threading.Event()
        self._is_closed = False
        # One frame waits while another is on its way.
        self._frames: queue.Queue[_Frame] = queue.Queue(maxsize=1)
        self._shapes = [] if self._is_remote else _by_shape(sim)
        self._tops = {name: np.zeros(3) if self._is_remote else _top(sim.parts(name)) for name in self._tracked}
        self._lines: dict[str, list[str]] = {}
        _log_bodies(recording, sim, self._tracked, self._shapes, self._is_remote)
        self._sender = threading.Thread(target=self._send, name="live view", daemon=True)
        self._sender.start()
        self.update()

    def __enter__(self) -> LiveView:
        return self

    def __exit__(self, kind: object, *error: object) -> None:
        if kind is None:
            self._show_last()
        self.close()

    def __repr__(self) -> str:
        return f"LiveView({self.frames} frames, {self.dropped_frames} dropped)"

    def update(self) -> None:
        """Takes over the last window of the simulation, and shows a frame if one is due. Call it after each window.

        Raises:
            RuntimeError: the view is closed, or a frame cannot be written.
        """
        if self._failure is not None:
            raise RuntimeError(f"live view: {self._failure}") from self._failure
        if self._is_closed:
            raise RuntimeError("live view: expected an open view, found a closed one")
        result, now_ns = self._sim.last, self._sim.now_ns
        if result is not None and result is not self._seen and result.status != "discard":
            self._take(result)
        if self._is_due(now_ns, result):
            self._show(now_ns)

    def close(self) -> None:
        """Ends the view. A viewer gets 3 s to take the last frames; a file is complete then.

        Raises:
            RuntimeError: a frame could not be written.
        """
        if self._is_closed:
            return
        self._is_closed = True
        self._is_closing.set()
        self._sender.join(None if self._waits else CLOSE_TIMEOUT_S)
        if self._sender.is_alive():
            # At the end of the program, Rerun would wait for this viewer for ever.
            importlib.import_module("rerun").unregister_shutdown()
        if self.dropped_frames:
            total = self.frames + self.dropped_frames
            text = f"live view: the viewer did not keep up, {self.dropped_frames} of {total} frames were dropped"
            warnings.warn(text, RuntimeWarning, stacklevel=2)
        if self._failure is not None:
            raise RuntimeError(f"live view: {self._failure}") from self._failure

    def _take(self, result: ballast.WindowResult) -> None:
        """Stores the scalars of a window, in place of those of a window that it repeats."""
        while self._windows and self._windows[-1][0] > result.t0_ns:
            self._windows.pop()
        self._seen = result
        values = {f"force/{name}": float(np.linalg.norm(result[name].moving_average_force)) for name in self._tracked}
        values |= _compactness(result.zones)
        values["kinetic_energy/stones"] = result.energy.kinetic
        solver = result.solver
        values["residual/qm16"] = solver.residual_qm16
        values["iterations/per_step"] = solver.iterations / max(result.steps, 1)
        values["penetration/largest"] = solver.max_penetration
        self._windows.append((result.t1_ns, values))

    def _is_due(self, now_ns: int, result: ballast.WindowResult | None) -> bool:
        shown_ns = self._shown_ns
        if shown_ns is not None and now_ns >= shown_ns:
            if now_ns == shown_ns and result is self._shown:
                return False
            # A repeated window replaces its frame.
            if now_ns > shown_ns and self._period_ns and now_ns // self._period_ns == shown_ns // self._period_ns:
                return False
        # A recording has the same frames on every machine.
        return self._waits or time.monotonic() - self._shown_s >= self._pause_s

    def _show(self, now_ns: int) -> None:
        self._shown_ns, self._shown_s, self._shown = now_ns, time.monotonic(), self._sim.last
        if not self._waits and self._frames.full():
            self.dropped_frames += 1
            return
        sim, result = self._sim, self._seen if self._sim.last is self._seen else None
        state = None if self._is_remote else sim.save()
        if self._zones and self._windows and not self._is_remote and result is not None and not result.zones:
            self._windows[-1][1].update(_compactness(sim.zones()))
        forces = {} if result is None else {name: result[name].moving_average_force for name in self._tracked}
        frame = _Frame(now_ns, state, self._poses(state, result), forces, list(self._windows))
        self._windows.clear()
        # A thread that has failed takes no frame: the next update tells why.
        while self._failure is None:
            with suppress(queue.Full):
                self._frames.put(frame, timeout=1.0)
                self.frames += 1
                break

    def _poses(self, state: ballast.State | None, result: ballast.WindowResult | None) -> dict[str, tuple[Any, Any]]:
        if state is not None:
            return {name: state.body(name)[:2] for name in self._tracked}
        if result is not None:
            return {name: (result[name].position, result[name].orientation) for name in self._tracked}
        saved = self._sim.save()
        return {name: saved.commanded_pose(name) for name in self._tracked}

    def _show_last(self) -> None:
        """Shows the last state, unless it is shown already or cannot be had."""
        with suppress(ballast.Error):
            if not self._is_closed and self._failure is None and self._sim.now_ns != self._shown_ns:
                self._show(self._sim.now_ns)

    def _send(self) -> None:
        """Sends frames until the view is closed. Runs in its own thread."""
        try:
            while (frame := self._next()) is not None:
                self._log(frame)
                if not self._waits:
                    self._wait_for_viewer()
            if self._waits:
                self._recording.flush()
            self._recording.disconnect()
        except BaseException as failure:
            self._failure = failure

    def _next(self) -> _Frame | None:
        while True:
            with suppress(queue.Empty):
                return self._frames.get(timeout=0.1)
            if self._is_closing.is_set():
                return None

    def _wait_for_viewer(self) -> None:
        """Waits until the viewer has taken the frame, if need be for ever; meanwhile frames are dropped."""
        try:
            self._recording.flush()
        except RuntimeError:
            # It is not there yet, or gone.
            self._is_closing.wait(1.0)

    def _log(self, frame: _Frame) -> None:
        rerun, recording = importlib.import_module("rerun"), self._recording
        recording.set_time(TIMELINE, duration=np.timedelta64(frame.time_ns, "ns"))
        if frame.state is not None:
            positions = frame.state.positions.astype(np.float32)
            orientations = frame.state.orientations.astype(np.float32)
            for shape, grains in self._shapes:
                poses = rerun.InstancePoses3D(translations=positions[grains], quaternions=orientations[grains])
                recording.log(_stones(shape), poses)
        for name, (position, orientation) in frame.poses.items():
            recording.log(["bed", "bodies", name], rerun.Transform3D(translation=position, quaternion=orientation))
            force = frame.forces.get(name)
            top = position + rotation(orientation) @ self._tops[name]
            arrows = ([], []) if force is None else ([top], [_arrow(force)])
            shown = rerun.Arrows3D(origins=arrows[0], vectors=arrows[1], colors=[FORCE], radii=ARROW_RADIUS)
            recording.log(["bed", "forces", name], shown)
        for name in dict.fromkeys(name for _, values in frame.windows for name in values):
            rows = [(time_ns, values[name]) for time_ns, values in frame.windows if name in values]
            times, scalars = zip(*rows, strict=True)
            column = rerun.TimeColumn(TIMELINE, duration=np.array(times, dtype="timedelta64[ns]"))
            path = rerun.new_entity_path(name.split("/"))
            plot, label = name.split("/", 1)
            others = self._lines.setdefault(plot, [])
            if label not in others:
                style = rerun.SeriesLines(names=[label], colors=[LINES[len(others) % len(LINES)]])
                recording.log(path, style, static=True)
                others.append(label)
            recording.send_columns(path, [column], rerun.Scalars.columns(scalars=scalars))


def live(
    sim: ballast.Simulation,
    to: str | os.PathLike[str] | None = None,
    *,
    period_s: float = 0.01,
    max_fps: float = 20.0,
    zones: bool = False,
) -> LiveView:
    """Returns a live view of a simulation in Rerun. Its `update` is called after each window.

        with ballast.open("examples/first.toml") as sim, ballast.view.live(sim) as viewer:
            while sim.phase != "done":
                sim.step_tamping_cycle()
                viewer.update()

    Args:
        sim: the simulation, of this process or remote.
        to: None: a window of the Rerun viewer, in a notebook an output of the cell; "web": a page in a browser, whose
            address is printed; an address such as "rerun+http://127.0.0.1:9876/proxy": a running viewer; else the path of
            a recording (`.rrd`).
        period_s: simulated time between frames, s; 0: a frame after each window.
        max_fps: largest number of frames per second of wall time. A file gets every frame.
        zones: measure the zones of the case for each frame; zones of windows with `zones=True` are always shown.

    Raises:
        ModuleNotFoundError: the extra `rerun` is not installed.
        FileExistsError: the file exists and is no recording of Rerun.
        RuntimeError: there is no screen for a window.
        ValueError: a number is out of range.
    """
    if not 0.0 <= period_s < math.inf:
        raise ValueError(f"period_s: expected a time of at least 0, s, found {period_s}")
    if not 0.0 < max_fps < math.inf:
        raise ValueError(f"max_fps: expected a number above 0, found {max_fps}")
    try:
        rerun = importlib.import_module("rerun")
        # Views of one process would else be one recording.
        recording = rerun.RecordingStream("ballast", recording_id=uuid.uuid4())
    except (ModuleNotFoundError, AttributeError):
        raise ModuleNotFoundError(f"ballast.view.live: {INSTALL}", name="rerun") from None
    # Times of the computer would make equal runs differ.
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    is_file = to is not None and not (isinstance(to, str) and (to == "web" or "://" in to))
    _connect(rerun, recording, to, is_file)
    return LiveView(sim, recording, waits=is_file, period_s=period_s, max_fps=max_fps, zones=zones)


def _connect(rerun: Any, recording: Any, to: str | os.PathLike[str] | None, is_file: bool) -> None:
    layout = _layout()
    if is_file:
        path = os.fspath(to or "")
        if os.path.exists(path):
            with open(path, "rb") as file:
                start = file.read(3)
            if start not in (b"", b"RRF"):
                raise FileExistsError(f"{path}: expected a new file, or a recording of Rerun to replace, found another")
        recording.save(path, default_blueprint=layout)
    elif to == "web":
        address = recording.serve_grpc(default_blueprint=layout)
        rerun.serve_web_viewer(open_browser=False)
        print(f"http://localhost:9090/?url={quote(address, safe='')}")
    elif to is not None:
        recording.connect_grpc(os.fspath(to), default_blueprint=layout)
    elif _in_notebook():
        if importlib.util.find_spec("rerun_notebook") is None:
            raise ModuleNotFoundError(f"ballast.view.live: {INSTALL}", name="rerun_notebook")
        recording.notebook_show(width="auto", blueprint=layout)
    else:
        if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            raise RuntimeError('live: expected a screen, found none; set `to` to "web" or to a file, such as "bed.rrd"')
        recording.spawn(default_blueprint=layout)


def _in_notebook() -> bool:
    shell = sys.modules.get("IPython")
    return shell is not None and type(shell.get_ipython()).__name__ == "ZMQInteractiveShell"


def _layout() -> Any:
    """Returns the arrangement of the viewer: the bed in 3D beside plots over simulated time."""
    blueprint = importlib.import_module("rerun.blueprint")

    def plots(name: str, **titles: str) -> Any:
        views = [blueprint.TimeSeriesView(origin=origin, name=title) for origin, title in titles.items()]
        return blueprint.Vertical(*views, name=name)

    about_bed = plots("bed", force="force, N", compactness="compactness", kinetic_energy="kinetic energy, J")
    about_solver = plots("solver", residual="residual (QM/16)", iterations="iterations", penetration="penetration, m")
    bed = blueprint.Spatial3DView(origin="bed", name="bed")
    sides = blueprint.Horizontal(bed, blueprint.Tabs(about_bed, about_solver), column_shares=[3, 2])
    return blueprint.Blueprint(sides, collapse_panels=True)


def _is_remote(sim: ballast.Simulation) -> bool:
    try:
        sim.shape_indices  # noqa: B018
    except ballast.RequestError as refused:
        if refused.code != "remote_unsupported":
            raise
        return True
    return False


def _by_shape(sim: ballast.Simulation) -> list[tuple[int, Any]]:
    """Returns the indices of the grains of each shape."""
    indices = sim.shape_indices
    return [(int(shape), np.flatnonzero(indices == shape)) for shape in np.unique(indices)]


def _top(solids: list[tuple[Any, list[list[int]]]]) -> Any:
    """Returns the middle of the highest corners of a body, in its frame."""
    corners = np.vstack([points for points, _ in solids])
    return corners[corners[:, 2] > corners[:, 2].max() - 1e-6].mean(axis=0)


def rotation(q: Any) -> Any:
    """Returns the rotation matrix (3, 3) of a unit quaternion x, y, z, w."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _mesh(solids: list[tuple[Any, list[list[int]]]], color: tuple[int, int, int]) -> Any:
    """Returns polyhedra as one `Mesh3D`, with corners for each face: edges stay sharp."""
    rerun = importlib.import_module("rerun")
    corners: list[Any] = []
    normals: list[Any] = []
    triangles: list[tuple[int, int, int]] = []
    for points, faces in solids:
        for face in faces:
            first = len(corners)
            ring = points[face]
            # Newell's sum: right for every planar polygon.
            normal = np.cross(ring, np.roll(ring, -1, axis=0)).sum(axis=0)
            corners.extend(ring)
            normals.extend([normal / max(float(np.linalg.norm(normal)), 1e-300)] * len(face))
            triangles += [(first, first + i, first + i + 1) for i in range(1, len(face) - 1)]
    return rerun.Mesh3D(
        vertex_positions=corners, vertex_normals=normals, triangle_indices=triangles, albedo_factor=color
    )


def _log_bodies(
    recording: Any, sim: ballast.Simulation, tracked: list[str], shapes: list[tuple[int, Any]], is_remote: bool
) -> None:
    """Sends everything that does not change: axes, shapes of stones and bodies."""
    rerun = importlib.import_module("rerun")
    recording.send_recording_name("remote" if is_remote else sim.case.name)
    recording.log("bed", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for shape, _ in shapes:
        recording.log(_stones(shape), _mesh([sim.shape(shape)], STONE), static=True)
    roles = sim.roles
    for name in tracked:
        path = ["bed", "bodies", name]
        if is_remote:
            recording.log(path, rerun.TransformAxes3D(0.1), static=True)
        else:
            recording.log(path, _mesh(sim.parts(name), TINE if roles[name] == "tine" else SLEEPER), static=True)


def _stones(shape: int) -> list[str]:
    return ["bed", "stones", f"shape_{shape}"]


def _arrow(force: Any) -> Any:
    length = METRES_PER_NEWTON * float(np.linalg.norm(force))
    return METRES_PER_NEWTON * force * min(1.0, MAX_ARROW_LENGTH / max(length, 1e-300))


def _compactness(zones: dict[str, ballast.ZoneResult]) -> dict[str, float]:
    return {f"compactness/{name}": z.compactness for name, z in zones.items() if z.compactness is not None}

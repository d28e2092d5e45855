"""Recordings in third-party readers: the values of the simulation in types of ROS."""

from __future__ import annotations

import re
import zlib
from collections import Counter
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import ballast
import numpy as np
import pytest
from conftest import ROOT, lowered
from numpy.typing import NDArray

for package in ("mcap", "mcap_ros2", "rosbags"):
    pytest.importorskip(package)

from check_recording import leaves, messages
from mcap.reader import make_reader
from mcap.records import Chunk, DataEnd, Footer, Header, Message
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

Floats = NDArray[np.float64]
# What is known of a body at a time: position, orientation, velocity, spin.
Place = tuple[Floats, Floats, Floats, Floats]

MAGIC = b"\x89MCAP0\r\n"
PICTURES = {"/stones", "/scene"}
# They contain more than results: inputs, and peak and onset of squeezes.
WIDER = {"/ballast/step", "/ballast/squeeze/pair_0"}
# The datatypes of PointField, from 1 on.
COLUMNS = dict(enumerate(("i1", "u1", "<i2", "<u2", "<i4", "<u4", "<f4", "<f8"), 1))


@dataclass
class Run:
    """A recording and the results of its windows."""

    path: Path
    start: ballast.State
    windows: list[tuple[ballast.WindowResult, ballast.State]]
    # Of each grain, in its own frame.
    corners: list[Floats]


@dataclass
class Seen:
    """A message as decoded by both readers."""

    topic: str
    time_ns: int
    message: Any
    leaves: dict[str, Any]


def played(case: ballast.Case, beds: Path, path: Path, *, is_tried: bool = True) -> Run:
    """Tines go down, then close, up to the tenth output, with which polyhedra stand; `is_tried`: the second
    window, at whose end an output is due, is computed otherwise first."""
    with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
        corners = [sim.shape(shape)[0] for shape in sim.shape_indices]
        run = Run(path, sim.save(), [], corners)
        sim.record(path)
        for i in range(12):
            is_closing = i >= 4
            steps = 10 if is_closing else 5
            end = sim.now_ns + steps * sim.step_ns
            motions = closed(sim, 2e-3, steps) if is_closing else lowered(sim, 1e-3, steps)
            # Zones are recorded where they were asked for.
            zones = not is_closing or i % 2 == 0
            if is_tried and i == 1:
                sim.advance_to(end, lowered(sim, 5e-4, steps), zones=zones)
                tried = sim.save().hash
                out = sim.redo(motions, zones=zones)
                assert sim.save().hash != tried
            else:
                out = sim.advance_to(end, motions, zones=zones)
            run.windows.append((out, sim.save()))
        sim.stop_recording()
    return run


def closed(sim: ballast.Simulation, way: float, steps: int) -> dict[str, ballast.Motion]:
    """Returns motions that close all tines by `way` (m) at constant speed in the next steps."""
    times = [sim.now_ns, sim.now_ns + steps * sim.step_ns]
    motions = {}
    for tine in sim.tines:
        x, q = sim.save().commanded_pose(tine.name)
        motions[tine.name] = ballast.Motion(times, [x, x + [tine.direction * way, 0.0, 0.0]], [q, q])
    return motions


@pytest.fixture(scope="module")
def run(case: ballast.Case, beds: Path, tmp_path_factory: pytest.TempPathFactory) -> Run:
    return played(case, beds, tmp_path_factory.mktemp("recording") / "run.mcap")


@pytest.fixture(scope="module")
def seen(run: Run) -> list[Seen]:
    return [Seen(*message) for message in messages(run.path)]


def named(values: Floats) -> dict[str, float]:
    """Returns a vector or quaternion as a message."""
    return dict(zip("xyzw", values.tolist()))


def stamp(time_ns: int) -> dict[str, int]:
    return {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}


def header(time_ns: int) -> dict[str, Any]:
    return {"stamp": stamp(time_ns), "frame_id": "world"}


def part(name: str) -> str:
    """Returns a name as part of a topic."""
    return re.sub("[^A-Za-z0-9]", "_", name)


def number(value: float | None) -> float:
    return np.nan if value is None else value


def tools(run: Run) -> list[str]:
    """Returns the bodies other than floor and walls."""
    return [n for n in run.windows[0][0].bodies if n.startswith(("tine", "sleeper"))]


def frames(time_ns: int, places: dict[str, Place]) -> dict[str, Any]:
    def frame(name: str, x: Floats, q: Floats) -> dict[str, Any]:
        transform = {"translation": named(x), "rotation": named(q)}
        return {"header": header(time_ns), "child_frame_id": name, "transform": transform}

    return {"transforms": [frame(name, x, q) for name, (x, q, _, _) in places.items()]}


def pose_and_twist(place: Place) -> tuple[dict[str, Any], dict[str, Any]]:
    x, q, v, w = map(named, place)
    return {"position": x, "orientation": q}, {"linear": v, "angular": w}


def configuration(time_ns: int, places: dict[str, Place]) -> dict[str, dict[str, Any]]:
    """Returns pose messages of tines and sleepers by topic."""
    reported = {"/clock": {"clock": stamp(time_ns)}, "/tf": frames(time_ns, places)}
    for name, place in places.items():
        pose, twist = pose_and_twist(place)
        reported[f"/{part(name)}/pose"] = {"header": header(time_ns), "pose": pose}
        reported[f"/{part(name)}/twist"] = {"header": header(time_ns), "twist": twist}
    return reported


def start_of(run: Run) -> dict[str, dict[str, Any]]:
    """Returns the first messages of a recording by topic."""
    places = {name: run.start.body(name) for name in run.windows[0][0].bodies}
    moving = {name: places.pop(name) for name in tools(run)}
    return configuration(0, moving) | {"/tf_static": frames(0, places)}


def window_of(run: Run, i: int) -> dict[str, dict[str, Any]]:
    """Returns the messages of a window without visualisation by topic."""
    out, state = run.windows[i]
    bodies, head = out.bodies, header(out.t1_ns)
    places = {n: (b.position, b.orientation, b.velocity, b.angular_velocity) for n, b in bodies.items()}
    reported = configuration(out.t1_ns, {name: places[name] for name in tools(run)})
    for name, body in bodies.items():
        pose, twist = pose_and_twist(places[name])
        mean = {"force": named(body.mean_force), "torque": named(body.mean_torque)}
        if name in tools(run):
            reported[f"/{part(name)}/wrench"] = {"header": head, "wrench": mean}
        reported[f"/{part(name)}/impulse"] = {
            "header": head,
            "body": name,
            "impulse": named(body.impulse),
            "angular_impulse": named(body.angular_impulse),
            "mean": mean,
            "moving_average": {"force": named(body.moving_average_force), "torque": named(body.moving_average_torque)},
            "peak_force": named(body.peak_force),
            "peak_torque": named(body.peak_torque),
            "peak_time_ns": body.peak_time_ns,
            "work": body.work,
            "contacts": body.contacts,
            "pose": pose,
            "twist": twist,
        }
    for name, zone in out.zones.items():
        reported[f"/ballast/zone/{part(name)}"] = {
            "header": head,
            "zone": name,
            "compactness": number(zone.compactness),
            "coordination": number(zone.coordination),
            "inertial_number": number(zone.inertial_number),
            "mean_pressure": zone.pressure,
            "low": named(zone.low),
            "high": named(zone.high),
        }
    for name, squeeze in out.squeezes.items():
        same = "number is_finished start_ns closing peak_force peak_step_force work compaction_energy"
        reported[f"/ballast/squeeze/{part(name)}"] = {
            "header": head,
            "pair": name,
            **fields(squeeze, same),
            "onset_ns": -1 if squeeze.onset_ns is None else squeeze.onset_ns,
            "loop_closing": squeeze.loop[:, 0],
            "loop_force": squeeze.loop[:, 1],
        }
    reported["/ballast/solver"] = fields(
        out.solver,
        "iterations visits steps_not_converged residual_qm16 residual_natural_map contacts active_contacts "
        "mean_penetration max_penetration force_difference force_compared complementarity_gap infeasible_work dissipated",
    )
    reported["/ballast/energy"] = fields(
        out.energy,
        "initial_kinetic initial_potential initial_elastic kinetic potential elastic external_work dissipated balance_error",
    )
    reported["/ballast/hash"] = {"bytes": bytes.fromhex(state.hash)}
    window = {"seq": i + 1, "t0_ns": out.t0_ns, "t1_ns": out.t1_ns}
    reported["/ballast/step"] = {**window, "request": window, "hash": reported["/ballast/hash"]}
    return reported


def fields(value: object, names: str) -> dict[str, Any]:
    return {name: getattr(value, name) for name in names.split()}


def test_recorded_numbers_equal_the_results(run: Run, seen: list[Seen]) -> None:
    reported = {0: start_of(run)}
    reported |= {out.t1_ns: window_of(run, i) for i, (out, _) in enumerate(run.windows)}
    # A redone window stands once, as it was in the end.
    assert Counter((s.topic, s.time_ns) for s in seen if s.topic not in PICTURES) == Counter(
        (topic, time_ns) for time_ns, window in reported.items() for topic in window
    )
    for s in seen:
        if s.topic not in PICTURES:
            expected = dict(leaves(reported[s.time_ns][s.topic]))
            found = {k: s.leaves.get(k) for k in expected} if s.topic in WIDER else s.leaves
            assert found == expected, (s.topic, s.time_ns)
    # None of this was idle.
    outs = [out for out, _ in run.windows]
    assert any(out.squeezes for out in outs) and not all(out.squeezes for out in outs)
    assert any(out.zones for out in outs) and not all(out.zones for out in outs)
    assert any(out[name].contacts for out in outs for name in tools(run))


def test_point_clouds_contain_the_grains(case: ballast.Case, run: Run, seen: list[Seen]) -> None:
    clouds = {s.time_ns: s.message for s in seen if s.topic == "/stones"}
    states = {0: run.start} | {
        out.t1_ns: state for out, state in run.windows if is_output_due(case, out)
    }
    assert clouds.keys() == states.keys() and len(clouds) == 11
    for time_ns, cloud in clouds.items():
        x, v = states[time_ns].positions, states[time_ns].velocities
        assert (cloud.height, cloud.width) == (1, len(x))
        assert cloud.width * cloud.point_step == cloud.row_step == len(cloud.data)
        assert cloud.is_dense and not cloud.is_bigendian
        ends = [f.offset + f.count * np.dtype(COLUMNS[f.datatype]).itemsize for f in cloud.fields]
        assert all(a <= b.offset for a, b in zip(ends, cloud.fields[1:]))
        assert ends[-1] <= cloud.point_step
        points = np.frombuffer(
            bytes(cloud.data),
            {
                "names": [f.name for f in cloud.fields],
                "formats": [(COLUMNS[f.datatype], f.count) for f in cloud.fields],
                "offsets": [f.offset for f in cloud.fields],
                "itemsize": cloud.point_step,
            },
        )
        assert points.dtype.names == ("x", "y", "z", "speed", "grain")
        for axis, column in zip("xyz", x.T):
            assert np.array_equal(points[axis].ravel(), column.astype(np.float32))
        speed = np.linalg.norm(v, axis=1)
        assert np.allclose(points["speed"].ravel(), speed, rtol=1e-6, atol=0.0)
        assert np.array_equal(points["grain"].ravel(), np.arange(len(x)))


def is_output_due(case: ballast.Case, out: ballast.WindowResult) -> bool:
    every_ns: int = round(case.to_dict()["run"]["output_interval_s"] * 1e9)
    return out.t1_ns // every_ns > out.t0_ns // every_ns


def array(points: Any) -> Floats:
    """Returns points, vectors or quaternions of messages as rows."""
    return np.array([[getattr(p, n) for n in "xyzw" if hasattr(p, n)] for p in points])


def rotated(q: Floats, v: Floats) -> Floats:
    """Returns vectors rotated by a quaternion x, y, z, w."""
    return v + 2.0 * np.cross(q[:3], np.cross(q[:3], v) + q[3] * v)


def test_polyhedra_and_arrows_have_the_poses_of_bodies(run: Run, seen: list[Seen]) -> None:
    scenes = {s.time_ns: s.message for s in seen if s.topic == "/scene"}
    last, end = run.windows[-1]
    assert list(scenes) == [0, last.t1_ns]
    for time_ns, state in (0, run.start), (last.t1_ns, end):
        assert not scenes[time_ns].deletions
        entities = {e.id: e for e in scenes[time_ns].entities}
        assert list(entities) == ["grains", *tools(run)]
        for entity in entities.values():
            assert entity.frame_id == "world"
            assert dict(leaves(entity.timestamp)) == dict(leaves(stamp(time_ns)))
            turns = array(p.pose.orientation for p in [*entity.triangles, *entity.arrows])
            assert np.allclose(np.linalg.norm(turns, axis=1), 1.0, rtol=0.0, atol=1e-12)
            [mesh] = entity.triangles
            assert len(mesh.points) > 3 and len(mesh.indices) > 3 and len(mesh.indices) % 3 == 0
            assert 0 <= min(mesh.indices) and max(mesh.indices) < len(mesh.points)
        # The mesh of the grains is in world axes: its own pose does nothing.
        [mesh] = entities["grains"].triangles
        assert array([mesh.pose.position]).tolist() == [[0.0, 0.0, 0.0]]
        assert array([mesh.pose.orientation]).tolist() == [[0.0, 0.0, 0.0, 1.0]]
        grains = zip(run.corners, state.positions, state.orientations, strict=True)
        corners = np.concatenate([x + rotated(q, c) for c, x, q in grains])
        assert np.allclose(array(mesh.points), corners, rtol=0.0, atol=1e-12)
        if time_ns == 0:
            assert not any(e.arrows for e in entities.values())
            continue
        forces = {name: last[name].moving_average_force for name in tools(run)}
        pushed = {name: force for name, force in forces.items() if force.any()}
        assert pushed.keys() == {e.id for e in entities.values() if e.arrows}
        assert pushed
        for name, force in pushed.items():
            [arrow] = entities[name].arrows
            assert dict(leaves(arrow.pose.position)) == dict(leaves(named(last[name].position)))
            length = np.linalg.norm(force)
            turned = rotated(array([arrow.pose.orientation])[0], np.array([1.0, 0.0, 0.0]))
            assert np.allclose(turned, force / length, rtol=0.0, atol=1e-9)
            reported = arrow.shaft_length + arrow.head_length
            assert reported == pytest.approx(min(2e-5 * length, 1.0), rel=1e-12)


def test_the_file_is_valid(run: Run, seen: list[Seen]) -> None:
    data = run.path.read_bytes()
    assert data.startswith(MAGIC) and data.endswith(MAGIC)
    # A checksum of 0 is none.
    frame = list(StreamReader(BytesIO(data), emit_chunks=True).records)
    chunks = [r for r in frame if isinstance(r, Chunk)]
    assert len(chunks) > 1 and all(chunk.uncompressed_crc for chunk in chunks)
    assert [r.data_section_crc != 0 for r in frame if isinstance(r, DataEnd)] == [True]
    # All checksums but the last one are compared by the reader; that one ends before itself and the magic.
    records = list(StreamReader(BytesIO(data), validate_crcs=True).records)
    assert isinstance(records[0], Header) and isinstance(records[-1], Footer)
    footer = records[-1]
    assert footer.summary_crc == zlib.crc32(data[footer.summary_start : -len(MAGIC) - 4])

    found = [r for r in records if isinstance(r, Message)]
    times = [m.log_time for m in found]
    assert times == sorted(times) == [m.publish_time for m in found]
    assert len(found) == len(seen)
    summary = make_reader(BytesIO(data)).get_summary()
    assert summary is not None and summary.statistics is not None
    channels, schemas = summary.channels, summary.schemas
    for channel in channels.values():
        assert (channel.message_encoding, schemas[channel.schema_id].encoding) == ("cdr", "ros2msg")
        mine = [m.sequence for m in found if m.channel_id == channel.id]
        assert mine == list(range(len(mine)))
    assert vars(summary.statistics) == {
        "message_count": len(found),
        "message_start_time": times[0],
        "message_end_time": times[-1],
        "channel_message_counts": Counter(m.channel_id for m in found),
        "channel_count": len(channels),
        "schema_count": len(schemas),
        "chunk_count": len(chunks),
        "metadata_count": 1,
        "attachment_count": 0,
    }
    with AnyReader([run.path]) as bag:
        counts = {topic: info.msgcount for topic, info in bag.topics.items()}
        assert bag.message_count == len(seen) and counts == Counter(s.topic for s in seen)


def test_standard_types_equal_those_of_ros(run: Run) -> None:
    folder = ROOT / "interfaces/protocol/msg"
    ours = get_typestore(Stores.EMPTY)
    for file in sorted(folder.glob("*/*.msg")):
        ours.register(get_types_from_msg(file.read_text(), f"{file.parent.name}/msg/{file.stem}"))
    with AnyReader([run.path]) as bag:
        embedded = bag.typestore
    # Definitions in the file are those that are published.
    for name in embedded.fielddefs:
        assert embedded.generate_msgdef(name, 2) == ours.generate_msgdef(name, 2), name
    releases = [r for r in Stores if r.name.startswith("ROS2")]
    assert Stores.ROS2_HUMBLE in releases
    for release in releases:
        stock = get_typestore(release)
        for name in ours.fielddefs:
            package = name.split("/")[0]
            assert (name in stock.fielddefs) == (package not in ("ballast_msgs", "foxglove_msgs"))
            if name in stock.fielddefs:
                # Names and types of all fields, to the bottom.
                assert ours.hash_rihs01(name) == stock.hash_rihs01(name), (release, name)
                # Later releases have more constants, and other words for the types of some.
                assert constants(ours, name).items() <= constants(stock, name).items(), (release, name)
            if name in stock.fielddefs and release == Stores.ROS2_HUMBLE:
                assert ours.generate_msgdef(name, 2) == stock.generate_msgdef(name, 2), name


def constants(store: Typestore, name: str) -> dict[str, Any]:
    return {constant: value for constant, _, value in store.fielddefs[name][0]}


def test_discarded_windows_are_not_recorded(
    run: Run, case: ballast.Case, beds: Path, tmp_path: Path
) -> None:
    other = played(case, beds, tmp_path / "other.mcap", is_tried=False)
    assert other.path.read_bytes() == run.path.read_bytes(), "equal runs leave equal bytes"

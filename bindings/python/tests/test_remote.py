"""Remote simulations: the same class and the same bytes as local ones."""

from __future__ import annotations

import contextlib
import json
import math
import pickle
import random
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import ballast
import numpy as np
import pytest
from conftest import ROOT
from test_simulation import begun

PROGRAM = ROOT / "target/release/ballast"
KEY = "test/bed"


def free_port() -> int:
    """Returns a free port below the ephemeral range of the system."""
    ports = range(32_000, 32_768)
    for port in random.sample(ports, len(ports)):
        with socket.socket() as one, contextlib.suppress(OSError):
            one.bind(("127.0.0.1", port))
            return port
    raise OSError("no port is free")


class Served:
    """A running `ballast serve` of the small case."""

    def __init__(self, beds: Path, folder: Path, case: Path = ROOT / "interfaces/cli/tests/data/tiny.toml") -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.command = [
            PROGRAM, "serve", case, "--key", KEY, "--listen", self.endpoint, "--bed-cache", beds, "--out", folder,
            "--checkpoint-interval", "0", "--threads", "1", "--json",
        ]  # fmt: skip
        self.start()

    def start(self, *more: str) -> None:
        self.process = subprocess.Popen(
            [*self.command, *more], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, pipesize=4096
        )
        assert self.process.stdout and self.process.stderr
        #: Events until it is ready, by name.
        self.events: dict[str, Any] = {}
        for line in self.process.stdout:
            event = json.loads(line)
            self.events[event["event"]] = event
            if event["event"] == "ready":
                return
        raise AssertionError(self.process.stderr.read())

    def open(self) -> ballast.Simulation:
        return ballast.open(f"zenoh:{KEY}", connect=self.endpoint)

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture
def served(beds: Path, tmp_path: Path) -> Iterator[Served]:
    served = Served(beds, tmp_path / "serve")
    yield served
    served.end()


def down(sim: ballast.Simulation, depth: float, steps: int) -> dict[str, ballast.Motion]:
    """Returns motions that lower all tines by `depth` (m) at constant speed in the next steps."""
    times = [sim.now_ns, sim.now_ns + steps * sim.step_ns]
    state, motions = sim.save(), {}
    for name in sim.bodies:
        if name.startswith("tine"):
            x, q = state.commanded_pose(name)
            motions[name] = ballast.Motion(times, [x, x - [0.0, 0.0, depth]], [q, q])
    return motions


def reported(sim: ballast.Simulation, out: ballast.WindowResult) -> object:
    """Returns the values of a result and the hash of the state, for bitwise comparison."""

    def numbers(body: object) -> list[object]:
        names = [n for n in dir(body) if not n.startswith("_")]
        return [(n, np.asarray(getattr(body, n)).tobytes()) for n in names]

    solver = [getattr(out.solver, n) for n in dir(out.solver) if not n.startswith("_")]
    energy = [getattr(out.energy, n) for n in dir(out.energy) if not n.startswith("_")]
    bodies = {name: numbers(body) for name, body in {**out.bodies, **out.squeezes}.items()}
    ends = (out.status, out.code, out.error_message, out.t0_ns, out.t1_ns, out.steps, out.max_knot_spacing_ns)
    return ends, bodies, solver, energy, sim.save().hash


def swing(sim: ballast.Simulation, names: Iterable[str]) -> dict[str, ballast.Motion]:
    """Returns cubic motions from the commanded velocity to 0.01 m/s downwards in two steps."""
    state, ends, motions = sim.save(), [sim.now_ns, sim.now_ns + 2 * sim.step_ns], {}
    for name in names:
        (x, q), twist = state.commanded_pose(name), state.commanded_twist(name)
        v = np.zeros(3) if twist is None else twist[0]
        down = np.array([0.0, 0.0, -0.01])
        way = (v + down) / 2 * 2e-9 * sim.step_ns
        motions[name] = ballast.Motion(ends, [x, x + way], [q, q], velocities=[v, down])
    return motions


def story(sim: ballast.Simulation) -> list[object]:
    """Returns the results of windows, a redo, a restored state and invalid requests."""
    h, said = sim.step_ns, []
    for n in (1, 3):
        said.append(reported(sim, sim.advance_to(sim.now_ns + n * h, down(sim, 2e-4 * n, n))))
    kept = sim.save()
    motions = down(sim, 4e-4, 2)
    said.append(reported(sim, sim.advance_to(sim.now_ns + 2 * h, motions)))
    slower = {name: ballast.Motion([kept.time_ns, kept.time_ns + 2 * h], [x, x - [0, 0, 1e-4]], [q, q])
              for name in motions for x, q in [kept.commanded_pose(name)]}  # fmt: skip
    said.append(reported(sim, sim.redo(slower)))
    said.append([x.tobytes() for name in motions for x in sim.save().commanded_pose(name)])
    assert all(sim.save().commanded_twist(name) is None for name in motions)
    for _ in range(2):
        said.append(reported(sim, sim.advance_to(sim.now_ns + 2 * h, swing(sim, motions))))
        twists = [sim.save().commanded_twist(name) for name in motions]
        said.append([twist and [x.tolist() for x in twist] for twist in twists])
        assert said[-1] == [[[0.0, 0.0, -0.01], [0.0, 0.0, 0.0]]] * len(motions)
    with pytest.raises(ballast.RequestError, match="expected a motion that continues it"):
        sim.advance_to(sim.now_ns + h)
    sim.restore(kept)
    said.append((sim.now_ns, sim.save().hash, kept.time_ns, kept.hash))
    said.append(reported(sim, sim.advance_to(sim.now_ns + 2 * h, motions)))
    for ask in (
        lambda: sim.advance_to(sim.now_ns + 1),
        lambda: sim.advance_to(sim.now_ns + h, {"unknown": next(iter(motions.values()))}),
        lambda: sim.advance_to(sim.now_ns + h, motions),
        lambda: (sim.restore(kept), sim.redo()),
        lambda: sim.save().commanded_pose("unknown"),
    ):
        with pytest.raises(ballast.RequestError) as refused:
            ask()
        said.append((refused.value.code, str(refused.value)))
    return said


def test_remote_results_equal_local_results(sim: ballast.Simulation, served: Served) -> None:
    with served.open() as there:
        assert isinstance(there, ballast.Simulation)
        assert (there.bodies, there.step_ns) == (sim.bodies, sim.step_ns)
        assert (there.grain_count, there.schedule) == (sim.grain_count, sim.schedule)
        assert there.roles == sim.roles and there.mounts.keys() == sim.mounts.keys()
        for name, mount in there.mounts.items():
            own = sim.mounts[name]
            assert (mount.mass, mount.dof_modes, repr(mount)) == (own.mass, own.dof_modes, repr(own))
            assert mount.stiffness.tolist() == own.stiffness.tolist() and mount.damping.tolist() == own.damping.tolist()
        assert story(there) == story(sim)
        outs = [s.advance_to(s.now_ns + 3 * s.step_ns, record_steps=True, zones=True) for s in (sim, there)]
        assert outs[0].zones.keys() == outs[1].zones.keys() and outs[0].zones
        here, elsewhere = (out.step_series for out in outs)
        assert here and elsewhere and len(here) == len(elsewhere) == 3
        assert here.time_ns.tolist() == elsewhere.time_ns.tolist()
        for name, rows in here.impulses.items():
            assert rows.tobytes() == elsewhere.impulses[name].tobytes()


def test_remote_tines_equal_local_tines(sim: ballast.Simulation, served: Served) -> None:
    def values(tine: ballast.Tine) -> list[object]:
        return [tine.name, tine.pair, tine.direction, tine.start.tolist(), tine.full_depth_z, tine.stroke]

    with served.open() as there:
        assert [values(tine) for tine in there.tines] == [values(tine) for tine in sim.tines] != []


def test_remote_parameters_equal_local_parameters(sim: ballast.Simulation, served: Served) -> None:
    with served.open() as there:
        ends = []
        for one in (sim, there):
            one.advance_to(one.now_ns + 5 * one.step_ns)
            before = one.save()
            one.set_parameters(max_iterations=3, tolerance=0.0)
            out = one.redo()
            assert out.solver.iterations < 5 * out.steps
            one.set_parameters(max_penetration=1e-12)
            assert one.redo().code == "penetration"
            one.restore(before)
            one.advance_to(one.now_ns + 5 * one.step_ns)
            ends.append(one.save().hash)
        assert ends[0] == ends[1]
        # What is not finite would be nothing on its way.
        for wrong in ({"max_iterations": 0}, {"tolerance": math.nan}, {"tolerance": math.inf}, {"tolerance": -1.0}):
            words = []
            for one in (sim, there):
                with pytest.raises(ballast.RequestError) as refused:
                    one.set_parameters(**wrong)  # type: ignore[arg-type]
                assert refused.value.code == "parameter_invalid"
                words.append(str(refused.value))
            assert words[0] == words[1]


def test_discarded_windows_have_no_steps(sim: ballast.Simulation, served: Served) -> None:
    """The window fails after two valid steps, which are not reported."""
    with served.open() as there:
        for s in (sim, there):
            h, name = s.step_ns, next(name for name in s.bodies if name.startswith("tine"))
            x, q = s.save().commanded_pose(name)
            motion = ballast.Motion([0, 2 * h, 3 * h], [x, x - [0, 0, 1e-4], x - [0, 0, 1]], [q] * 3)
            out = s.advance_to(3 * h, {name: motion}, record_steps=True)
            assert (out.status, out.code, out.steps) == ("discard", "over_speed", 0)
            assert out.step_series is not None and len(out.step_series) == 0
            assert list(out.step_series.impulses) == s.bodies
            assert all(rows.shape == (0, 6) for rows in out.step_series.impulses.values())


def test_a_new_owner_continues_moving_tines(served: Served) -> None:
    pytest.importorskip("zenoh")
    with served.open() as there:
        (x, q), last, speed = there.save().commanded_pose("tine_1_plus"), 3 * there.step_ns, [0.0, 0.0, -0.1]
        way = [x, x + np.array(speed) * last * 1e-9]
        motion = ballast.Motion([0, last], way, [q, q], velocities=[speed, speed], allow_jump=True)
        there.advance_to(last, {"tine_1_plus": motion})
    script = ROOT / "examples/python/controller_zenoh.py"
    called = [sys.executable, script, KEY, "2000", "0.002", served.endpoint]
    done = subprocess.run(called, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    with served.open() as there:
        assert there.now_ns > last


def test_a_full_event_pipe_does_not_block_the_server(served: Served) -> None:
    windows = 40  # whose events are more than the pipe takes
    with served.open() as there:
        for _ in range(windows):
            there.advance_to(there.now_ns + there.step_ns)
        assert there.now_ns == windows * there.step_ns
    served.process.terminate()
    out, err = served.process.communicate()
    events = [json.loads(line) for line in out.splitlines()]
    kept = [event["seq"] for event in events if event["event"] == "checkpoint"]
    assert len(out) > 4096 and kept == list(range(1, windows + 1))
    assert events[-1]["event"] == "error" and events[-2]["event"] == "done"
    assert "stopped cleanly" in err.splitlines()[-1] and "--resume" in err.splitlines()[-1]


def test_remote_simulations_refuse_local_operations(sim: ballast.Simulation, served: Served, tmp_path: Path) -> None:
    with served.open() as there:
        kept = there.save()
        for ask in (
            there.fork, there.zones, there.step_tamping_cycle, lambda: there.case, lambda: there.masses,
            lambda: there.stones, lambda: there.phase, lambda: there.record(tmp_path / "run.mcap"), lambda: kept.positions,
            lambda: kept.write(tmp_path / "state.h5"), lambda: ballast.resume(kept), lambda: there.threads,
            lambda: there.shape_indices, lambda: there.shape(0), lambda: kept.step, lambda: kept.body("floor"),
        ):  # fmt: skip
            with pytest.raises(ballast.RequestError, match="found a remote one") as refused:
                ask()
            assert refused.value.code == "remote_unsupported"
        for to, state in ((sim, kept), (there, sim.save())):
            with pytest.raises(ballast.RequestError, match="state: expected") as refused:
                to.restore(state)
            assert refused.value.code == "state_invalid"
        with pytest.raises(ballast.RequestError) as refused:
            there.advance_to(there.step_ns + 1)
        assert refused.value.nearest_ns == (there.step_ns, 2 * there.step_ns)
        for beyond in (2**63, 2**64 - 1):
            with pytest.raises(ballast.RequestError, match=f"t1_ns: expected .* to 2.63 - 1.*, found {beyond}"):
                there.advance_to(beyond)
            late = ballast.Motion([0, beyond], [[0, 0, 0]] * 2)
            with pytest.raises(ballast.RequestError, match=f"times_ns: expected .*, found {beyond}"):
                there.advance_to(there.step_ns, {"tine_1_plus": late})
        with pytest.raises(ballast.RequestError, match="python") as refused:
            served.open()
        assert refused.value.code == "busy"
    assert there.is_closed
    with pytest.raises(ballast.RemoteError, match="site/id|SITE/ID|key") as unreachable:
        ballast.open("zenoh:nonsense")
    assert unreachable.value.code == "invalid_name"


def test_unreferenced_remote_states_are_released(served: Served) -> None:
    with served.open() as there:
        first = there.save()
        # More than a component keeps.
        for _ in range(100):
            there.save()
        there.restore(first)


def test_a_pickled_remote_state_is_restored_by_another_process(served: Served) -> None:
    with served.open() as there:
        there.advance_to(there.now_ns + 2 * there.step_ns, down(there, 1e-4, 2))
        kept = there.save()
        hashes = [kept.hash]
        pickled = pickle.dumps(kept)
        unpickled = pickle.loads(pickled)
        for name in there.bodies:
            for part, other in zip(kept.commanded_pose(name), unpickled.commanded_pose(name), strict=True):
                assert part.tolist() == other.tolist()
        there.advance_to(there.now_ns + 2 * there.step_ns, down(there, 1e-4, 2))
        hashes.append(there.save().hash)
    with served.open() as other:
        other.restore(pickle.loads(pickled))
        assert other.save().hash == hashes[0]
        other.advance_to(other.now_ns + 2 * other.step_ns, down(other, 1e-4, 2))
        assert other.save().hash == hashes[1]
        # The first restored copy is not referenced any more.
        with pytest.raises(ballast.RequestError):
            other.restore(pickle.loads(pickled))


def test_a_restarted_component_continues(sim: ballast.Simulation, served: Served) -> None:
    with served.open() as there:
        for s in (sim, there):
            s.advance_to(s.now_ns + 2 * s.step_ns, down(s, 1e-4, 2))
        motions = down(there, 2e-4, 2)
        served.end()
        with pytest.raises(ballast.RemoteError) as lost:
            there.advance_to(there.now_ns + 2 * there.step_ns, motions)
        assert lost.value.code == "disconnected"
        served.start("--resume")
        out = there.advance_to(there.now_ns + 2 * there.step_ns, motions)
        expected = reported(sim, sim.advance_to(sim.now_ns + 2 * sim.step_ns, down(sim, 2e-4, 2)))
        assert reported(there, out) == expected


def test_ctrl_c_does_not_wait_for_a_remote_window(sim: ballast.Simulation, served: Served) -> None:
    # Long enough to be interrupted on any machine.
    n = 1500
    with served.open() as there:
        end, motions = n * sim.step_ns, down(there, 1e-3, n)
        threading.Timer(0.1, lambda: signal.raise_signal(signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            there.advance_to(end, motions)
        # The server continues the window, and the repeated call returns its result.
        out = there.advance_to(end, motions)
        assert out.steps == n
        assert reported(there, out) == reported(sim, sim.advance_to(end, down(sim, 1e-3, n)))
        # Any other call comes after it.
        threading.Timer(0.1, lambda: signal.raise_signal(signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt):
            there.advance_to(2 * end)
        assert there.last is out
        assert there.save().time_ns == 2 * end == there.now_ns
        # No call has waited for its result.
        assert there.last is not None and (there.last.t1_ns, there.last.steps) == (2 * end, n)


def test_stop_cancels_a_remote_wait(served: Served) -> None:
    with ThreadPoolExecutor(1) as pool, served.open() as there:
        there.stop()
        n, begin = 1500, there.now_ns
        window = begun(there, pool, n)
        there.stop()
        with pytest.raises(ballast.RemoteError, match="cancelled after") as unreachable:
            window.result(timeout=60)
        assert unreachable.value.code == "cancelled" and there.last is None
        # The server continues the window, and the repeated call returns its result.
        out = there.advance_to(begin + n * there.step_ns)
        assert out.steps == n and there.last is out
        window = begun(there, pool, 100_000)
        there.close()
        with pytest.raises(ballast.RemoteError):
            window.result(timeout=60)


def test_close_does_not_wait_for_a_cancelled_remote_window(served: Served) -> None:
    with pytest.raises(KeyboardInterrupt):
        with served.open() as there:
            threading.Timer(0.3, lambda: signal.raise_signal(signal.SIGINT)).start()
            there.advance_to(there.now_ns + 100_000 * there.step_ns)
    # It is still computing; without the word of its partner it ends with the process.
    assert served.process.poll() is None


def test_states_of_a_previous_owner_are_released(served: Served) -> None:
    with served.open() as there:
        kept = [there.save() for _ in range(64)]
        with pytest.raises(ballast.RequestError, match="at most 64") as refused:
            there.save()
        assert refused.value.code == "too_many_states"
    with served.open() as there:
        again = [there.save() for _ in range(64)]
        there.restore(again[0])
        with pytest.raises(ballast.RequestError, match="one that this simulation has saved"):
            there.restore(kept[0])


FORKED = """
import multiprocessing, sys
import ballast

def opened():
    return ballast.open(sys.argv[1], connect=sys.argv[2])

def in_a_fork(sim):
    refused = []
    for ask in (opened, lambda: sim.advance_to(sim.now_ns + sim.step_ns), sim.save):
        try:
            ask()
        except ballast.RequestError as error:
            refused.append(error.code)
    sim.close()
    sys.exit(0 if refused == ["forked_process"] * 3 else 1)

with opened() as sim:
    process = multiprocessing.get_context("fork").Process(target=in_a_fork, args=(sim,))
    process.start()
    process.join(30)
    assert process.exitcode == 0, process.exitcode
    sim.advance_to(sim.now_ns + sim.step_ns)
"""


def test_forked_processes_cannot_use_remote_simulations(served: Served) -> None:
    command = [sys.executable, "-c", FORKED, f"zenoh:{KEY}", served.endpoint]
    subprocess.run(command, check=True, timeout=60)

"""Windows, states, arrays, threads, signals and recordings of local simulations."""

from __future__ import annotations

import copy
import gc
import math
import os
import pickle
import re
import resource
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import MappingProxyType

import ballast
import numpy as np
import pytest
from conftest import ROOT, lowered

STEPS = 20


def advance(sim: ballast.Simulation, steps: int = STEPS) -> ballast.WindowResult:
    return sim.advance_to(sim.now_ns + steps * sim.step_ns)


def end_of(sim: ballast.Simulation) -> str:
    """Returns the hash after some windows with motions."""
    for _ in range(3):
        sim.advance_to(sim.now_ns + 5 * sim.step_ns, lowered(sim, 1e-4, 5))
    return sim.save().hash


def test_boundary_impulses_balance_the_weight(sim: ballast.Simulation) -> None:
    def momentum() -> float:
        return float((sim.masses[:, None] * sim.save().velocities).sum(axis=0)[2])

    before = momentum()
    out = advance(sim, 50)
    assert out.status in ("ok", "warn")
    # Newton for all grains at once: weight and reactions over the window are the change of momentum.
    weight = -9.81 * sim.masses.sum() * (out.t1_ns - out.t0_ns) * 1e-9
    reaction = -sum(body.impulse[2] for body in out.bodies.values())
    assert weight + reaction == pytest.approx(momentum() - before, abs=1e-9 * abs(weight))
    assert reaction == pytest.approx(-weight, rel=0.05)


def test_stones_have_shape_and_grading(sim: ballast.Simulation) -> None:
    stones = sim.stones
    assert stones is not None
    assert 0.7 < stones["sphericity"]["mean"] < 1.0
    passing = [point["passing"] for point in stones["grading"]]
    assert passing == sorted(passing) and passing[-1] == pytest.approx(1.0)
    assert 0.0 <= stones["flakiness_index"] <= 1.0 and 0.0 <= stones["shape_index"] <= 1.0


def test_results_are_consistent(sim: ballast.Simulation) -> None:
    out = sim.advance_to(10 * sim.step_ns, lowered(sim, 1e-3, 10), record_steps=True, zones=True)
    assert (out.t0_ns, out.t1_ns, out.steps) == (0, 10 * sim.step_ns, 10)
    assert set(out.bodies) == set(sim.bodies)
    series = out.step_series
    assert series is not None and len(series) == 10
    for name, rows in series.impulses.items():
        body = out[name]
        assert np.allclose(rows[:, :3].sum(axis=0), body.impulse, rtol=1e-12, atol=1e-15)
        assert np.allclose(body.mean_force * 10 * sim.step_ns * 1e-9, body.impulse)
    tine = sim.tines[0]
    assert out[tine.name].position[2] == pytest.approx(tine.start[2] - 1e-3, abs=1e-4)
    assert 0.2 < min(z.compactness for z in out.zones.values() if z.compactness) < 0.9
    assert out.energy.balance_error == pytest.approx(0.0, abs=1e-3)
    assert list(out.zones) == list(sim.zones())
    assert all(z.compactness == out.zones[n].compactness for n, z in sim.zones().items())
    assert not sim.advance_to(11 * sim.step_ns).zones
    assert tine.name in out and "unknown" not in out and 1 not in out
    # It is a mapping of bodies.
    assert list(out) == list(out.keys()) == sim.bodies and len(out) == len(sim.bodies)
    assert [body.work for body in dict(out).values()] == [body.work for body in out.values()]
    assert {name: body.work for name, body in out.items()} == {name: out[name].work for name in out}
    assert repr(out.solver).startswith(f"SolverResult({out.solver.iterations} iterations, ")
    assert repr(out.energy).startswith("EnergyLedger(kinetic=") and repr(series) == "StepSeries(10 steps)"
    with pytest.raises(KeyError, match=f"'body: expected one of .*{tine.name}.*, found unknown'"):
        out["unknown"]


def test_squeezes_are_measured(case: ballast.Case, beds: Path) -> None:
    reported = []
    # On the case's own bed the tines jam, and are not open again at the end.
    with ballast.open(case.choose(seed=12), bed_cache=beds, threads=1, progress=False) as sim:
        for _ in range(sim.case.duration_ns // sim.step_ns):
            reported += sim.step_tamping_cycle().squeezes.values()
    assert reported and {s.number for s in reported} == {1}
    last = reported[-1]
    assert last.is_finished and not any(s.is_finished for s in reported[:-1])
    # The tiny case closes by several millimetres, and opens again in the withdrawal.
    closing, force = last.loop.T
    assert closing.max() > 5e-3 and closing.max() == max(s.closing for s in reported)
    assert last.peak_force == np.abs(force).max() <= last.peak_step_force
    again = pickle.loads(pickle.dumps(last))
    assert isinstance(again, ballast.Squeeze) and repr(again) == repr(last) and np.array_equal(again.loop, last.loop)


def test_tines_have_the_pair_number_of_the_case(case: ballast.Case, beds: Path) -> None:
    lone = {"name": "lone", "x_m": 0.03, "y_m": 0.05, "squeeze_direction": "+x", "pair": 5,
            "blade_size_m": [0.01, 0.02, 0.02], "shaft_size_m": [0.01, 0.01, 0.1]}  # fmt: skip
    case = case.with_values({"tine": [lone]})
    with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
        pairs = {tine.name: tine.pair for tine in sim.tines}
        assert pairs.pop("lone") == 5 and set(pairs.values()) == {0}


def test_redo_depends_only_on_its_inputs(sim: ballast.Simulation) -> None:
    sim.advance_to(5 * sim.step_ns, lowered(sim, 1e-3, 5))
    end = 10 * sim.step_ns
    motions = lowered(sim, 1e-3, 5)
    sim.advance_to(end, motions)
    first = sim.save().hash
    sim.redo()
    other = sim.save().hash
    assert other != first
    for _ in range(3):
        sim.redo(motions)
        assert sim.save().hash == first


def test_redo_of_an_early_window_reaches_the_requested_end(case: ballast.Case, beds: Path) -> None:
    with ballast.open(case, bed_cache=beds, threads=1, progress=False, keep_partial_window=True) as sim:
        end, tine = 10 * sim.step_ns, sim.tines[0].name
        at, _ = sim.save().commanded_pose(tine)
        away = at + [0.0, 0.0, 10.0]
        jump = ballast.Motion([0, 5 * sim.step_ns, 6 * sim.step_ns, end], [at, at, away, away])
        out = sim.advance_to(end, {tine: jump})
        assert out.status == "early" and 0 < out.t1_ns == sim.now_ns < end, out.error_message
        assert sim.redo().t1_ns == sim.now_ns == end


def test_restored_simulations_equal_uninterrupted_ones(
    sim: ballast.Simulation, case: ballast.Case, beds: Path, tmp_path: Path
) -> None:
    advance(sim)
    kept, fork = sim.save(), sim.fork()
    end = end_of(sim)
    sim.restore(kept)
    assert end_of(sim) == end, "restored"
    assert end_of(fork) == end, "forked"
    kept.write(tmp_path / "state.h5")
    assert end_of(ballast.resume(tmp_path / "state.h5", threads=2)) == end, "another file, two threads"
    program = (
        "import sys; sys.path.insert(0, sys.argv[2]); import ballast; from test_simulation import end_of\n"
        "print(end_of(ballast.resume(sys.argv[1], threads=1)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path / "state.h5", Path(__file__).parent],
        capture_output=True, text=True, check=True,
    )
    assert done.stdout.strip() == end, "another process"
    with ballast.open(case, bed_cache=beds, seed=99, threads=1, progress=False) as other:
        with pytest.raises(ballast.RequestError, match="another model"):
            other.restore(kept)


def measured(sim: ballast.Simulation) -> list[tuple[object, ...]]:
    return [(z.compactness, z.coordination, z.inertial_number, z.pressure) for z in sim.zones().values()]


def test_zones_depend_only_on_the_state(sim: ballast.Simulation, tmp_path: Path) -> None:
    for _ in range(60):
        sim.step_tamping_cycle()
    kept, zones = sim.save(), measured(sim)
    assert any(coordination for _, coordination, _, _ in zones)
    kept.write(tmp_path / "state.h5")
    for again in (sim.fork(), ballast.resume(kept, threads=1), ballast.resume(tmp_path / "state.h5", threads=1)):
        assert measured(again) == zones
    advance(sim, 30)
    assert measured(sim) != zones
    sim.restore(kept)
    assert measured(sim) == zones


def test_forks_can_redo_the_last_step_of_the_tamping_cycle(sim: ballast.Simulation) -> None:
    for _ in range(65):
        sim.step_tamping_cycle()
    fork = sim.fork()
    for one in (sim, fork):
        one.redo()
        for _ in range(10):
            one.step_tamping_cycle()
    assert fork.save().hash == sim.save().hash


def test_states_of_another_case_are_refused(sim: ballast.Simulation, case: ballast.Case, beds: Path) -> None:
    other = case.with_values({"tamping.vibration.frequency_Hz": 20.0})
    with ballast.open(other, bed_cache=beds, threads=1, progress=False) as elsewhere:
        with pytest.raises(ballast.RequestError, match="found one of another machine on the same bed"):
            sim.restore(elsewhere.save())


FORKED = """
import multiprocessing, sys
import ballast

def step(sim, reported):
    sim.advance_to(sim.now_ns + 5 * sim.step_ns)
    reported.put(sim.save().hash)

def elsewhere(sim):
    reported = fork.Queue()
    process = fork.Process(target=step, args=(sim, reported))
    process.start()
    hash = reported.get(timeout=60)
    process.join(60)
    return hash

fork = multiprocessing.get_context("fork")
case, beds = ballast.Case.load(sys.argv[1]), sys.argv[2]
first = ballast.open(case, bed_cache=beds, threads=2, progress=False)
step(first, fork.SimpleQueue())
second = ballast.open(case, bed_cache=beds, threads=3, progress=False)
step(second, fork.SimpleQueue())
hashes = [elsewhere(first), elsewhere(second)]
for sim in (first, second):
    sim.advance_to(sim.now_ns + 5 * sim.step_ns)
assert hashes == [sim.save().hash for sim in (first, second)], hashes

def intrude(sim, reported):
    refused = []
    for ask in (lambda: sim.advance_to(sim.now_ns + sim.step_ns), sim.stop_recording):
        try:
            ask()
        except ballast.RequestError as error:
            refused.append((error.code, error.found))
    reported.put(refused)

first.record(sys.argv[3])
first.advance_to(first.now_ns + sim.step_ns)
reported = fork.Queue()
process = fork.Process(target=intrude, args=(first, reported))
process.start()
assert reported.get(timeout=60) == [("recording", "a fork of it")] * 2
process.join(60)
first.advance_to(first.now_ns + sim.step_ns)
first.stop_recording()
assert len(list(ballast.read(sys.argv[3]))) == 2
"""


def test_forked_processes_compute_but_do_not_record(beds: Path, tmp_path: Path) -> None:
    file = ROOT / "interfaces/cli/tests/data/tiny.toml"
    called = [sys.executable, "-W", "ignore", "-c", FORKED, file, beds, tmp_path / "forked.mcap"]
    done = subprocess.run(called, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr


def test_the_tamping_cycle_continues_from_a_file(sim: ballast.Simulation, tmp_path: Path) -> None:
    for _ in range(40):
        sim.step_tamping_cycle()
    sim.save().write(tmp_path / "state.h5")
    with ballast.resume(tmp_path / "state.h5", threads=1) as again:
        for _ in range(20):
            sim.step_tamping_cycle()
            again.step_tamping_cycle()
        assert again.phase == sim.phase
        assert again.save().hash == sim.save().hash


def test_arrays_are_views_of_immutable_states(sim: ballast.Simulation) -> None:
    before = sim.save().positions
    address = before.__array_interface__["data"][0]
    assert sim.save().positions.__array_interface__["data"][0] == address, "no copy"
    assert before.shape == (sim.grain_count, 3)
    with pytest.raises(ValueError, match="read-only"):
        before[0, 0] = 1.0
    with pytest.raises(ValueError, match="WRITEABLE"):
        before.flags.writeable = True
    values = before.copy()
    advance(sim, 50)
    after = sim.save().positions
    assert np.array_equal(before, values) and not np.array_equal(after, values)
    values = after.copy()
    quaternions = sim.save().orientations
    assert np.allclose(np.linalg.norm(quaternions, axis=1), 1.0)
    sim.close()
    del sim
    gc.collect()
    assert np.array_equal(after, values), "it outlives the simulation"


def test_unaligned_inputs_are_copied(sim: ballast.Simulation) -> None:
    # As of a log that is read from its bytes: doubles lie where no double of an array does.
    tine, end = sim.tines[0].name, 10 * sim.step_ns
    log = np.zeros(2, np.dtype([("ms", "<u4"), ("x", "<f8", (3,)), ("q", "<f8", (4,))]))
    log["x"], log["q"] = sim.save().commanded_pose(tine)
    log["x"][1] += [1e-4, -2e-4, -3e-4]
    assert log["x"].strides[0] % 8 and not log["x"].flags.aligned
    begun = sim.save()
    for x, q in ((log["x"], log["q"]), (log["x"][:, ::-1][:, ::-1], np.asfortranarray(log["q"]))):
        sim.restore(begun)
        sim.advance_to(end, {tine: ballast.Motion([0, end], x, q)})
        assert np.array_equal(sim.save().commanded_pose(tine)[0], log["x"][1])
    assert isinstance(sim.save().body(tine), tuple) and isinstance(begun.commanded_pose(tine), tuple)
    assert isinstance(sim.save().commanded_twist(sim.tines[1].name), tuple)


def test_contact_points_lie_on_grains(sim: ballast.Simulation) -> None:
    advance(sim)
    state = sim.save()
    pairs, impulses, points = state.contact_bodies, state.contact_impulses, state.contact_points
    assert pairs.shape == (len(impulses), 2) and points.shape == impulses.shape
    assert (pairs[:, 0] < sim.grain_count).all()
    reach = np.linalg.norm(points - state.positions[pairs[:, 0]], axis=1)
    corners = [np.linalg.norm(sim.shape(s)[0], axis=1).max() for s in range(sim.shape_indices.max() + 1)]
    assert (reach <= 1.1 * np.array(corners)[sim.shape_indices[pairs[:, 0]]]).all()


def test_ten_simulations_in_ten_threads(case: ballast.Case, beds: Path) -> None:
    def run(_: int) -> str:
        with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
            return end_of(sim)

    alone = run(0)
    with ThreadPoolExecutor(10) as pool:
        assert set(pool.map(run, range(10))) == {alone}


def test_results_do_not_depend_on_the_calling_thread(case: ballast.Case, beds: Path) -> None:
    """A calling thread is a worker of one pool only; with another number of threads it waits for other workers."""

    def run(stepping: list[ThreadPoolExecutor], threads: int) -> str:
        opened = stepping[0].submit(ballast.open, case, bed_cache=beds, threads=threads, progress=False)
        with opened.result() as sim:
            assert sim.threads == threads
            for thread in stepping:
                end = thread.submit(end_of, sim).result()
        return end

    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(1) as other:
        alone = run([one, one, one], 2)
        assert [run([one, other, one], threads) for threads in (2, 3, 1)] == [alone] * 3


def test_thread_counts_out_of_range_are_refused(case: ballast.Case, beds: Path) -> None:
    with pytest.raises(ballast.Error, match="expected 1 to 1024, found 0") as none:
        ballast.open(case, bed_cache=beds, threads=0, progress=False)
    assert none.value.code == "threads"
    for threads in (100_000, -1, 2**70):
        with pytest.raises(ballast.Error, match=f"threads: expected 1 to 1024, found {threads}"):
            ballast.open(case, bed_cache=beds, threads=threads, progress=False)


def test_resume_refuses_beds(case: ballast.Case, beds: Path) -> None:
    bed = ballast.prepare(case, bed_cache=beds, progress=False)
    with pytest.raises(ballast.FileError, match="expected the state of a run, found a bed"):
        ballast.resume(bed)


def test_concurrent_calls_raise_busy(sim: ballast.Simulation) -> None:
    thread = threading.Thread(target=advance, args=(sim, 200))
    thread.start()
    codes = set()
    while thread.is_alive():
        assert not sim.has_failed and not sim.is_closed
        try:
            sim.save()
        except ballast.Error as error:
            codes.add(error.code)
        assert "closed" not in repr(sim)
    thread.join()
    assert codes <= {"busy"}
    assert "closed" not in repr(sim)
    assert sim.now_ns == 200 * sim.step_ns


def test_panics_raise_internal_error(sim: ballast.Simulation) -> None:
    advance(sim)
    kept = sim.save()
    end = end_of(sim)
    sim.restore(kept)
    sim._fail_next()
    with pytest.raises(ballast.InternalError, match="panic requested by a test"):
        advance(sim)
    assert sim.has_failed
    with pytest.raises(ballast.InternalError, match="restore a saved state"):
        advance(sim)
    assert sim.save().hash == kept.hash
    sim.restore(kept)
    assert not sim.has_failed and end_of(sim) == end


@pytest.mark.parametrize(
    ("code", "ask"),
    [
        ("time_grid", lambda sim: sim.advance_to(sim.step_ns + 1)),
        ("time_grid", lambda sim: sim.advance_to(0)),
        ("nothing_to_redo", lambda sim: sim.redo()),
        ("unknown_body", lambda sim: advance_with(sim, "unknown", [0, sim.step_ns])),
        ("input_gap", lambda sim: advance_with(sim, sim.tines[0].name, [0, sim.step_ns - 1])),
        ("input_jump", lambda sim: advance_with(sim, sim.tines[0].name, [0, sim.step_ns], 1.0)),
        ("input_invalid", lambda sim: advance_with(sim, sim.tines[0].name, [0, sim.step_ns], np.nan)),
        ("input_invalid", lambda sim: advance_with(sim, sim.tines[0].name, [sim.step_ns, 0])),
        ("input_invalid", lambda sim: ballast.Motion([-1], [[0, 0, 0]])),
        ("input_invalid", lambda sim: ballast.Motion([0, 1], [[0, 0, 0]])),
        ("input_invalid", lambda sim: ballast.Motion([0], [[0, 0, 0]], [[0, 0, 0, 2]])),
        ("input_invalid", lambda sim: ballast.Motion([0], [[0, 0, 0]], interpolation="spline")),
        ("input_invalid", lambda sim: ballast.Motion([0], [0, 0, 0])),
        ("input_invalid", lambda sim: ballast.Motion([0], "high")),
        ("input_invalid", lambda sim: ballast.Motion([0, 1], [[0, 0, 0], [0]])),
        ("input_invalid", lambda sim: ballast.Motion([2**64], [[0, 0, 0]])),
        ("input_invalid", lambda sim: sim.advance_to(-5)),
        ("input_invalid", lambda sim: sim.advance_to(2**70)),
        ("input_invalid", lambda sim: ballast.Motion([0, 1], [[0, 0, 0]] * 2, interpolation="hermite")),
        ("input_invalid", lambda sim: ballast.Motion([0], [[0, 0, 0]], angular_velocities=[[0, 0, np.nan]])),
        ("input_invalid", lambda sim: ballast.Load([0, 1], [[0, 0, 0], [0, 0, np.inf]])),
        ("input_invalid", lambda sim: ballast.Load([0], [[0, 0, 0]], [[np.nan, 0, 0]])),
        ("input_invalid", lambda sim: ballast.open(sim.case, max_penetration=-1.0)),
        ("input_invalid", lambda sim: ballast.resume(sim.save(), max_penetration=0.0)),
        ("input_invalid", lambda sim: ballast.resume(sim.save(), max_penetration=np.nan)),
    ],
)
def test_invalid_requests_are_refused(sim: ballast.Simulation, code: str, ask) -> None:
    before = sim.save().hash
    with pytest.raises(ballast.RequestError, match="expected .* found") as refused:
        ask(sim)
    assert refused.value.code == code
    assert sim.save().hash == before and sim.now_ns == 0


def test_argument_errors_have_parts(sim: ballast.Simulation) -> None:
    turned = [[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 2.0]]
    for ask, place in [
        (lambda: ballast.Motion([0, 1], np.zeros((2, 3)), turned), "orientations"),
        (lambda: ballast.Motion([0, 1], np.zeros((2, 3)), angular_velocities=np.zeros((2, 3))), "velocities"),
        (lambda: sim.save().body("x"), "body"),
        (lambda: sim.save().commanded_pose("x"), "body"),
    ]:
        with pytest.raises(ballast.RequestError) as refused:
            ask()
        assert refused.value.place == place and refused.value.expected and refused.value.found, refused.value


def test_request_errors_have_parts(sim: ballast.Simulation) -> None:
    with pytest.raises(ballast.RequestError) as refused:
        sim.advance_to(sim.step_ns + 1)
    assert (refused.value.place, refused.value.found) == ("t1_ns", f"{sim.step_ns + 1} ns")
    assert refused.value.nearest_ns == (sim.step_ns, 2 * sim.step_ns)
    tine = sim.tines[0].name
    with pytest.raises(ballast.RequestError) as refused:
        advance_with(sim, tine, [0, sim.step_ns - 1])
    assert refused.value.place == tine and refused.value.nearest_ns is None
    assert f"{refused.value.expected}, found {refused.value.found}" in str(refused.value)
    with pytest.raises(ballast.RequestError) as refused:
        ballast.Load([0, 1], [[0, 0, 0], [0, 0, np.inf]])
    assert (refused.value.place, refused.value.found) == ("forces", "inf (row 1)")


def advance_with(
    sim: ballast.Simulation, body: str, times: list[int], off: float = 0.0
) -> ballast.WindowResult:
    position = sim.save().commanded_pose(sim.tines[0].name)[0] + off
    motion = ballast.Motion(times, [position] * len(times))
    return sim.advance_to(sim.step_ns, {body: motion})


@pytest.mark.parametrize(
    ("said", "ask"),
    [
        ("t1_ns: expected a whole number of ns, found 0.001", lambda sim: sim.advance_to(1e-3)),
        ("times_ns[1]: expected a whole number of ns, found 0.5", lambda sim: ballast.Load([0, 0.5], [[0, 0, 0]] * 2)),
        ("motions: expected a mapping from names of bodies, found <class 'list'>", lambda sim: sim.redo([])),
        ("motions: key 1: expected the name of a body, found <class 'int'>", lambda sim: sim.redo({1: None})),
        ("loads['a']: expected <class 'ballast.Load'>, found <class 'int'>", lambda sim: sim.redo(loads={"a": 1})),
    ],
)
def test_wrong_types_raise_type_error(sim: ballast.Simulation, said: str, ask) -> None:
    with pytest.raises(TypeError, match=re.escape(said)):
        ask(sim)


def test_motions_accept_any_mapping(sim: ballast.Simulation) -> None:
    end, start, motions = 5 * sim.step_ns, sim.save(), lowered(sim, 1e-3, 5)
    hashes = set()
    for mapping in (motions, MappingProxyType(motions)):
        sim.restore(start)
        sim.advance_to(end, mapping)
        hashes.add(sim.save().hash)
    assert len(hashes) == 1


def test_closed_simulations_raise(sim: ballast.Simulation) -> None:
    sim.close()
    sim.close()
    assert sim.is_closed
    with pytest.raises(ballast.Error, match="was closed") as closed:
        advance(sim)
    assert closed.value.code == "closed"


def begun(sim: ballast.Simulation, pool: ThreadPoolExecutor, steps: int, **asked: bool) -> Future[ballast.WindowResult]:
    """Returns the future of a window that another thread is computing."""
    end, is_near = sim.now_ns + steps * sim.step_ns, threading.Event()

    def window() -> ballast.WindowResult:
        is_near.set()
        return sim.advance_to(end, **asked)

    computed = pool.submit(window)
    assert is_near.wait(60)
    time.sleep(0.3)
    assert not computed.done()
    return computed


#: Number of steps of a window that takes hours.
MANY = 10_000_000


def test_stop_cancels_a_window(sim: ballast.Simulation) -> None:
    sim.stop()
    assert sim.last is None
    with ThreadPoolExecutor(1) as pool:
        window = begun(sim, pool, MANY, record_steps=True, zones=True)
        sim.stop()
        out = window.result(timeout=60)
    assert (out.status, out.code) == ("early", "stopped") and "`stop`" in (out.error_message or "")
    assert 0 < out.steps == len(out.step_series or []) and out.zones
    assert out.t1_ns == sim.now_ns == out.steps * sim.step_ns
    assert sim.last is out
    # It ends no window to come.
    sim.stop()
    assert advance(sim).steps == STEPS


@pytest.mark.parametrize("threads", [1, 2])
def test_close_cancels_the_window_of_another_thread(case: ballast.Case, beds: Path, threads: int) -> None:
    with ThreadPoolExecutor(1) as pool:
        with pytest.raises(KeyboardInterrupt):
            with ballast.open(case, bed_cache=beds, threads=threads, progress=False) as sim:
                window = begun(sim, pool, MANY)
                raise KeyboardInterrupt
        assert sim.is_closed and sim.last is window.result(timeout=60)
        assert (window.result().status, window.result().code) == ("early", "stopped")
        with pytest.raises(ballast.Error, match="was closed") as closed:
            pool.submit(advance, sim).result(timeout=60)
        assert closed.value.code == "closed"


def test_ctrl_c_closes_a_simulation_that_another_thread_steps(sim: ballast.Simulation) -> None:
    with ThreadPoolExecutor(1) as pool, pytest.raises(KeyboardInterrupt):
        with sim:
            window = begun(sim, pool, MANY)
            threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
            window.result(timeout=60)
    assert window.result(timeout=60).code == "stopped"


def test_signal_handlers_cannot_close_but_stop(sim: ballast.Simulation) -> None:
    codes = []

    def handle(*_: object) -> None:
        try:
            sim.close()
        except ballast.Error as error:
            codes.append(error.code)
        sim.stop()

    before = signal.signal(signal.SIGINT, handle)
    try:
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        assert advance(sim, MANY).code == "stopped"
    finally:
        signal.signal(signal.SIGINT, before)
    assert codes == ["busy"] and not sim.is_closed
    advance(sim)


def test_close_errors_become_notes(
    sim: ballast.Simulation, case: ballast.Case, beds: Path, tmp_path: Path
) -> None:
    def unwritten(sim: ballast.Simulation) -> None:
        """Makes the recording of a simulation fail."""
        sim.record(tmp_path / "run.mcap")
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
        try:
            with pytest.warns(RuntimeWarning, match="cannot write"):
                for steps in range(1, 61):
                    sim.advance_to(steps * sim.step_ns)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)

    with pytest.raises(ZeroDivisionError) as raised, sim:
        unwritten(sim)
        _ = 1 // 0
    [note] = raised.value.__notes__
    assert note.startswith("close: ") and "cannot write" in note
    with pytest.raises(ballast.FileError, match="cannot write"):
        with ballast.open(case, bed_cache=beds, threads=1, progress=False) as other:
            unwritten(other)


def interrupted_window(sim: ballast.Simulation) -> None:
    """Interrupts a long window by Ctrl-C."""
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        advance(sim, MANY)
    timer.join()


def test_ctrl_c_leaves_a_valid_state(sim: ballast.Simulation) -> None:
    interrupted_window(sim)
    now, out = sim.now_ns, sim.last
    assert 0 < now < MANY * sim.step_ns and now % sim.step_ns == 0
    assert out is not None and (out.status, out.code) == ("early", "stopped")
    assert (out.t0_ns, out.t1_ns, out.steps) == (0, now, now // sim.step_ns)
    assert "KeyboardInterrupt" in (out.error_message or "") and out["floor"].impulse[2] < 0.0
    interrupted = sim.save()
    advance(sim)
    after = sim.save().hash
    sim.restore(interrupted)
    advance(sim)
    assert sim.save().hash == after


def endless(case: ballast.Case) -> ballast.Case:
    """Returns the case with steps that never converge."""
    values = case.to_dict()
    values["solver"] |= {"max_iterations": 4_000_000_000, "tolerance": 1e-300}
    return ballast.Case.from_dict(values)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_endless_steps_are_cancelled(case: ballast.Case, beds: Path, threads: int) -> None:
    with ballast.open(endless(case), bed_cache=beds, threads=threads, progress=False) as sim:
        before = sim.save().hash
        interrupted_window(sim)
        out = sim.last
        assert out is not None and (out.status, out.code, out.steps) == ("discard", "stopped", 0)
        assert "KeyboardInterrupt" in (out.error_message or "") and sim.save().hash == before
        with ThreadPoolExecutor(1) as pool:
            window = begun(sim, pool, 1)
            sim.stop()
            out = window.result(timeout=60)
        assert (out.status, out.code, out.steps) == ("discard", "stopped", 0) and sim.save().hash == before


def handled_within_a_step(case: ballast.Case, beds: Path) -> list[str]:
    """Returns the error codes of a signal handler that computes during an endless step of two threads."""
    codes = []

    def handle(*_: object) -> None:
        try:
            advance(other)
        except ballast.Error as error:
            codes.append(error.code)
        sim.stop()

    opened = partial(ballast.open, bed_cache=beds, threads=2, progress=False)
    with opened(case) as other, opened(endless(case)) as sim:
        signal.signal(signal.SIGINT, handle)
        threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
        assert advance(sim).code == "stopped"
        advance(other)
    return codes


def in_another_process(case: ballast.Case, beds: Path, what: str) -> str:
    """Returns the output of a program whose main thread is a worker."""
    case.write(beds / "case.toml")
    code = (
        "import sys, ballast; from test_simulation import *\n"
        "case, beds = ballast.Case.load(sys.argv[1]), sys.argv[2]\n"
    )
    again = [sys.executable, "-c", code + what, str(beds / "case.toml"), str(beds)]
    done = subprocess.run(again, cwd=Path(__file__).parent, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_ctrl_c_cancels_multithreaded_windows(case: ballast.Case, beds: Path) -> None:
    what = (
        "with ballast.open(case, bed_cache=beds, threads=2, progress=False) as sim:\n"
        "    interrupted_window(sim)\n"
        "    print(sim.now_ns)"
    )
    assert int(in_another_process(case, beds, what)) > 0


def test_signal_handlers_within_a_step_are_refused(case: ballast.Case, beds: Path) -> None:
    assert in_another_process(case, beds, "print(handled_within_a_step(case, beds))") == "['busy']"


def test_last_is_the_result_of_the_last_window(sim: ballast.Simulation) -> None:
    assert sim.last is None
    out = advance(sim)
    kept = sim.save()
    assert sim.last is out and sim.fork().last is out
    again = sim.redo()
    assert sim.last is again is not out
    with pytest.raises(ballast.RequestError):
        sim.advance_to(0)
    assert sim.last is again
    sim.restore(kept)
    assert sim.last is None
    out = sim.step_tamping_cycle()
    assert sim.last is out
    sim._fail_next()
    with pytest.raises(ballast.InternalError):
        advance(sim)
    assert sim.last is None


def test_max_penetration_discards_windows(case: ballast.Case, beds: Path) -> None:
    options = {"bed_cache": beds, "threads": 1, "progress": False, "max_penetration": 1e-12}
    with ballast.open(case, **options) as sim:
        out = advance(sim)
        assert (out.status, out.code) == ("discard", "penetration") and "expected" in (out.error_message or "")
        assert sim.now_ns == 0


def test_recordings_can_be_verified_and_replayed(sim: ballast.Simulation, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    sim.record(path)
    with pytest.raises(ballast.RequestError, match="recording"):
        sim.record(path)
    sim.advance_to(5 * sim.step_ns, lowered(sim, 1e-3, 5))
    sim.redo(lowered_back(sim))
    sim.advance_to(10 * sim.step_ns, lowered(sim, 1e-3, 5))
    with pytest.raises(ballast.RequestError):
        sim.restore(sim.save())
    final = sim.save().hash
    sim.stop_recording()
    recording = ballast.read(path)
    assert isinstance(recording, ballast.Recording)
    windows = list(recording)
    assert [(w["request"]["t0_ns"], w["request"]["t1_ns"]) for w in windows] == [
        (0, 5 * sim.step_ns), (5 * sim.step_ns, 10 * sim.step_ns),
    ]
    record = {"seq", "t0_ns", "t1_ns", "request", "hash", "reply_digest"}
    assert set(windows[0]) == record | {"motions", "loads", "parameters", "result"}
    assert all(f"`{part}`" in str(ballast.Recording.__doc__) for part in windows[0])
    call(tmp_path, "verify", path)
    assert final in call(tmp_path, "replay", path, "--out", tmp_path / "replay")


def numbers(out: ballast.WindowResult) -> object:
    """Returns all values of a result that recordings contain."""

    def of(part: object) -> list[object]:
        names = [name for name in dir(part) if not name.startswith("_")]
        return [(name, np.asarray(getattr(part, name)).tobytes()) for name in names]

    parts = [*out.values(), *out.zones.values(), *out.squeezes.values(), out.solver, out.energy]
    ends = (out.status, out.code, out.error_message, out.t0_ns, out.t1_ns, out.steps)
    return ends, list(out), list(out.zones), list(out.squeezes), [of(part) for part in parts]


def test_recorded_windows_can_be_repeated(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    spring = {"mass_kg": 2, "z": "spring", "stiffness_N_per_m": 1e6}
    sprung, path = case.with_values({"sleepers.mount": spring}), tmp_path / "run.mcap"
    with ballast.open(sprung, bed_cache=beds, seed=12, threads=1, progress=False) as sim:
        h, reported, hashes = sim.step_ns, [], []
        sim.record(path)
        assert {name for name, role in sim.roles.items() if role == "tine"} == {tine.name for tine in sim.tines}
        for interpolation in ("hold", "linear"):
            times, now = [sim.now_ns, sim.now_ns + 2 * h, sim.now_ns + 6 * h], sim.now_ns
            push = ballast.Load(times, [[0, 0, 0], [1, 2, -900], [3, 0, -100]], [[0, 1, 0]] * 3, interpolation=interpolation)
            reported.append(sim.advance_to(now + 5 * h, lowered(sim, 1e-3, 6), {"sleeper_1": push}, zones=True))
            hashes.append(sim.save().hash)
        ends = sim.save().commanded_pose(tine := sim.tines[0].name)[0], sim.now_ns
        turned = [[0, 0, 0, 1], [0, 0, np.sin(0.01), np.cos(0.01)]]
        swing = ballast.Motion([ends[1], ends[1] + 4 * h], [ends[0]] * 2, turned, velocities=np.zeros((2, 3)),
                               angular_velocities=np.zeros((2, 3)), allow_jump=True)  # fmt: skip
        reported.append(sim.advance_to(ends[1] + 4 * h, {tine: swing}))
        hashes.append(sim.save().hash)
        for _ in range(120):
            reported.append(sim.step_tamping_cycle())
            hashes.append(sim.save().hash)
    recording = ballast.read(path)
    assert isinstance(recording, ballast.Recording) and recording.start is None
    assert recording.case == sim.case and recording.case.seed == 12
    assert repr(recording) == f'Recording("{path}")'
    windows = list(recording)
    assert any(window["result"].squeezes for window in windows) and windows[0]["result"].zones
    with ballast.open(recording.case, bed_cache=beds, threads=1, progress=False) as again:
        for window, out, hash in zip(windows, reported, hashes, strict=True):
            kept = window["result"]
            assert numbers(kept) == numbers(out)
            assert np.isnan(kept.wall_time_s) and (kept.max_knot_spacing_ns, kept.step_series) == (0, None)
            again.advance_to(window["t1_ns"], window["motions"], window["loads"])
            assert again.save().hash == window["hash"] == hash


def test_recordings_contain_their_initial_state(sim: ballast.Simulation, beds: Path, tmp_path: Path) -> None:
    advance(sim)
    kept = sim.save()
    sim.record(tmp_path / "later.mcap")
    end = end_of(sim)
    sim.close()
    recording = ballast.read(tmp_path / "later.mcap")
    assert isinstance(recording, ballast.Recording) and recording.start is not None
    assert recording.start.hash == kept.hash
    with ballast.open(recording.case, bed_cache=beds, threads=1, progress=False) as again:
        again.restore(recording.start)
        for window in recording:
            again.advance_to(window["t1_ns"], window["motions"], window["loads"])
        assert again.save().hash == end


def test_parameters_are_recorded_and_part_of_states(sim: ballast.Simulation, beds: Path, tmp_path: Path) -> None:
    sim.record(tmp_path / "set.mcap")
    advance(sim)
    loose = sim.save()
    sim.set_parameters(max_iterations=3)
    assert sim.save().hash != loose.hash, "the fingerprint covers how steps are solved"
    out = advance(sim)
    assert out.solver.iterations < 5 * out.steps
    end = end_of(sim)
    hasty = sim.save()
    sim.stop_recording()
    recording = ballast.read(tmp_path / "set.mcap")
    assert isinstance(recording, ballast.Recording)
    with ballast.open(recording.case, bed_cache=beds, threads=1, progress=False) as again:
        reported = []
        for window in recording:
            again.set_parameters(**window["parameters"])
            again.advance_to(window["t1_ns"], window["motions"], window["loads"])
            assert again.save().hash == window["hash"]
            reported.append(window["parameters"])
        assert again.save().hash == end
        assert reported[0] == {} and reported[1] == {"max_iterations": 3, "tolerance": 1e-3}
        # A state brings its own, whoever takes it up.
        again.restore(loose)
        assert again.save().hash == loose.hash
        again.restore(hasty)
        assert again.save().hash == hasty.hash
        out = advance(again)
        assert out.solver.iterations < 5 * out.steps
        again.set_parameters(max_penetration=1e-12)
        assert advance(again).code == "penetration"
        again.set_parameters(max_penetration=math.inf)
        assert advance(again).steps > 0
        for wrong in (
            {"max_iterations": 0},
            {"max_iterations": -1},
            {"max_iterations": 1 << 40},
            {"tolerance": -1.0},
            {"tolerance": math.nan},
            {"max_penetration": 0.0},
        ):
            with pytest.raises(ballast.RequestError) as refused:
                again.set_parameters(**wrong)  # type: ignore[arg-type]
            assert refused.value.code == "parameter_invalid"


def test_recordings_of_the_program_are_readable(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    case.write(tmp_path / "tiny.toml")
    path = tmp_path / "run.mcap"
    call(tmp_path, "run", tmp_path / "tiny.toml", "--record", path, "--out", tmp_path / "run")
    with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
        for count, window in enumerate(ballast.read(path), 1):
            out = sim.advance_to(window["t1_ns"], window["motions"], window["loads"])
            assert numbers(window["result"])[0] == (out.status, None, None, out.t0_ns, out.t1_ns, 1)
            assert all(body.work == out[name].work for name, body in window["result"].items())
    assert count == 180


def test_states_motions_and_loads_can_be_pickled(sim: ballast.Simulation, tmp_path: Path) -> None:
    for _ in range(65):
        sim.step_tamping_cycle()
    state = sim.save()
    again = pickle.loads(pickle.dumps(state))
    assert again.hash == state.hash and repr(again) == repr(state)
    assert copy.copy(state) is state and copy.deepcopy([state])[0] is state
    with ballast.resume(again, threads=1) as other:
        for _ in range(10):
            sim.step_tamping_cycle()
            other.step_tamping_cycle()
        assert other.save().hash == sim.save().hash
    for motion in (
        ballast.Motion([], np.zeros((0, 3))),
        ballast.Motion([1, 2**64 - 1], [[0.1, 0.2, 0.3], [1e-300, -0.0, 3.0]], allow_jump=True),
        ballast.Motion([5], [[1, 2, 3]], [[0.6, 0, 0, 0.8]], interpolation="hold"),
        ballast.Motion([5], [[1, 2, 3]], interpolation="hermite"),
        ballast.Motion([1, 5], np.eye(2, 3), [[0.6, 0, 0, 0.8], [0, 0.6, 0.8, 0]], velocities=np.ones((2, 3)), angular_velocities=np.eye(2, 3)),
    ):
        for made in (pickle.loads(pickle.dumps(motion)), copy.copy(motion), copy.deepcopy(motion)):
            assert isinstance(made, ballast.Motion) and repr(made) == repr(motion)
            assert parts_of(made) == parts_of(motion)
    for interpolation in ("hold", "linear"):
        load = ballast.Load([1, 2], np.eye(2, 3), -np.eye(2, 3) / 3, interpolation=interpolation)
        made = pickle.loads(pickle.dumps(load))
        assert isinstance(made, ballast.Load) and parts_of(made) == parts_of(load)
        assert parts_of(load)[1]["interpolation"] == interpolation


def test_results_can_be_pickled(sim: ballast.Simulation) -> None:
    plain = sim.advance_to(5 * sim.step_ns)
    out = sim.advance_to(10 * sim.step_ns, lowered(sim, 1e-3, 5), record_steps=True, zones=True)
    assert plain.step_series is None and out.zones
    for result in (plain, out):
        for again in (pickle.loads(pickle.dumps(result)), copy.copy(result), copy.deepcopy(result)):
            assert isinstance(again, ballast.WindowResult) and repr(again) == repr(result)
            assert numbers(again) == numbers(result)
            assert (again.wall_time_s, again.max_knot_spacing_ns) == (result.wall_time_s, result.max_knot_spacing_ns)
            assert (again.step_series is None) == (result.step_series is None)
    series = out.step_series
    assert series is not None
    again = pickle.loads(pickle.dumps(series))
    assert len(again) == 5 and again.time_ns.tolist() == series.time_ns.tolist()
    assert all(rows.tobytes() == again.impulses[name].tobytes() for name, rows in series.impulses.items())
    for part in (*out.values(), *out.zones.values(), out.solver, out.energy):
        made = pickle.loads(pickle.dumps(part))
        assert type(made) is type(part) and repr(made) == repr(part)


def parts_of(input: ballast.Motion | ballast.Load) -> tuple[list[bytes], dict[str, object]]:
    rows, named = input.__getnewargs_ex__()
    plain = {name: value if np.ndim(value) == 0 else value.tobytes() for name, value in named.items()}
    return [np.asarray(row).tobytes() for row in rows], plain


def test_roles_and_mounts(case: ballast.Case, beds: Path) -> None:
    spring = {"mass_kg": 2, "z": "spring", "stiffness_N_per_m": 1e6, "damping_N_s_per_m": 3e3}
    own = case.with_values({"sleepers.mount": spring, "tines.mount.rigid": True})
    with ballast.open(own, bed_cache=beds, threads=1, progress=False) as sim:
        roles = {"sleeper_1": "sleeper", "tine_1_plus": "tine", "tine_1_minus": "tine"}
        assert list(sim.roles) == sim.bodies
        assert sim.roles == {name: roles.get(name, "boundary") for name in sim.bodies}
        [(name, mount)] = sim.mounts.items()
        assert name == "sleeper_1" and mount.mass == 2.0
        assert mount.dof_modes == ("prescribed", "prescribed", "spring", "prescribed", "prescribed", "prescribed")
        assert mount.stiffness.tolist() == [0, 0, 1e6, 0, 0, 0] and mount.damping.tolist() == [0, 0, 3e3, 0, 0, 0]
        assert repr(mount) == "Mount(2 kg, prescribed, prescribed, spring, prescribed, prescribed, prescribed)"


def test_shape_accepts_negative_indices(sim: ballast.Simulation) -> None:
    # Those of driven bodies come after those of the grains.
    n = int(sim.shape_indices.max()) + 1
    with suppress(IndexError):
        while True:
            sim.shape(n)
            n += 1
    assert np.array_equal(sim.shape(-1)[0], sim.shape(n - 1)[0]) and np.array_equal(sim.shape(-n)[0], sim.shape(0)[0])
    for beyond in (n, -n - 1, 2**70, -(2**70)):
        with pytest.raises(IndexError, match=f"shape: expected -{n} to {n - 1}, found {beyond}"):
            sim.shape(beyond)


def test_recordings_can_start_at_any_window(sim: ballast.Simulation, tmp_path: Path) -> None:
    sim.advance_to(5 * sim.step_ns, lowered(sim, 1e-3, 5))
    sim.record(tmp_path / "later.mcap")
    with pytest.raises(ballast.RequestError, match="starts at") as refused:
        sim.redo()
    assert refused.value.code == "recording"
    sim.advance_to(10 * sim.step_ns, lowered(sim, 1e-3, 5))
    final = sim.save().hash
    sim.stop_recording()
    assert "1 windows" in call(tmp_path, "verify", tmp_path / "later.mcap")
    assert final in call(tmp_path, "replay", tmp_path / "later.mcap", "--out", tmp_path / "replay")


def test_interrupted_windows_are_recorded(
    sim: ballast.Simulation, tmp_path: Path
) -> None:
    sim.record(tmp_path / "run.mcap")
    interrupted_window(sim)
    advance(sim)
    sim.stop_recording()
    call(tmp_path, "verify", tmp_path / "run.mcap")


def test_recordings_are_complete_without_close(
    case: ballast.Case, beds: Path, tmp_path: Path
) -> None:
    sim = ballast.open(case, bed_cache=beds, threads=1, progress=False)
    sim.record(tmp_path / "run.mcap")
    for _ in range(3):
        advance(sim)
    del sim
    assert "3 windows" in call(tmp_path, "verify", tmp_path / "run.mcap")


def test_recordings_end_at_a_panic(sim: ballast.Simulation, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    sim.record(path)
    advance(sim)
    state = sim.save()
    sim._fail_next()
    with pytest.raises(ballast.InternalError):
        advance(sim)
    sim.restore(state)
    advance(sim)
    with pytest.raises(ballast.FileError, match="by an internal error"):
        sim.stop_recording()
    assert len(list(ballast.read(path))) == 1


def test_states_contain_the_penetration_limit(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    with ballast.open(case, bed_cache=beds, threads=1, progress=False, max_penetration=1e-12) as sim:
        state = sim.save()
    with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
        free = pickle.loads(pickle.dumps(sim.save()))
    state.write(tmp_path / "state.h5")
    copies = (state, pickle.loads(pickle.dumps(state)), ballast.State.read(tmp_path / "state.h5"))
    for copy in copies:
        with ballast.resume(copy, threads=1) as again:
            assert again.advance_to(5 * again.step_ns).code == "penetration"
        with ballast.resume(copy, threads=1, max_penetration=math.inf) as again:
            assert again.advance_to(5 * again.step_ns).code is None
            again.restore(copy)
            assert again.advance_to(5 * again.step_ns).code == "penetration"
            again.restore(free)
            assert again.advance_to(5 * again.step_ns).code is None


def test_window_results_are_mappings(sim: ballast.Simulation) -> None:
    out = advance(sim)
    assert isinstance(out, Mapping)
    name = next(iter(out))
    found = out.get(name)
    assert found is not None and found.work == out[name].work
    assert out.get("unknown") is None and out.get("unknown", 3) == 3


def test_failed_recordings_lose_no_window(
    sim: ballast.Simulation, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    sim.record(path)
    reported: list[str] = []
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    # A limit on the size of files stands in for a full disk; Python ignores its signal.
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, before[1]))
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            for steps in range(1, 61):
                assert sim.advance_to(steps * sim.step_ns).t1_ns == steps * sim.step_ns
            reported = [str(w.message) for w in caught if w.category is RuntimeWarning]
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert len(reported) == 1, reported
    assert "run.mcap: cannot write" in reported[0] and "continues without recording" in reported[0]
    with pytest.raises(ballast.RequestError, match="stop_recording first"):
        sim.record(path)
    with pytest.raises(ballast.FileError, match="run.mcap: cannot write"):
        sim.stop_recording()
    sim.stop_recording()
    sim.record(path)
    advance(sim)
    sim.stop_recording()
    assert len(list(ballast.read(path))) == 1


def call(folder: Path, command: str, path: Path, *more: str | Path) -> str:
    """Returns the output of a command of the program for a recording."""
    program = Path(os.environ.get("BALLAST_PROGRAM", ROOT / "target/release/ballast"))
    if not program.exists():
        pytest.skip(f"{program} is not built")
    called = [program, command, path, "--bed-cache", folder / "beds", *more]
    done = subprocess.run(called, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return done.stdout


def lowered_back(sim: ballast.Simulation) -> dict[str, ballast.Motion]:
    """Returns motions that hold the tines at their start."""
    times = [0, 5 * sim.step_ns]
    return {t.name: ballast.Motion(times, [t.start, t.start]) for t in sim.tines}


def test_a_sleeper_is_probed_and_the_simulation_stays_as_it_is(sim: ballast.Simulation) -> None:
    advance(sim)
    before = sim.save().hash
    support = sim.probe_stiffness(max_load=300.0, min_load=50.0, cycles=1, ramp=0.02)
    assert support["load"].max() == pytest.approx(300.0)
    [cycle] = support["cycles"]
    assert cycle["settlement"] == support["settlement"][19] > 0 and cycle["rest"] == support["settlement"][-1]
    push = sim.probe_push("sleeper_1", displacement=3e-4, speed=0.02, seating=0.02)
    assert push["displacement"][-1] == pytest.approx(3e-4, rel=0.1)
    assert push["force"].max() > 0 and push["weight"] > 0 and push["force_at_2_mm"] is None
    assert sim.save().hash == before
    with pytest.raises(ballast.RequestError, match="sleeper_1"):
        sim.probe_push("bench")
    with pytest.raises(ballast.RequestError, match="largest load"):
        sim.probe_stiffness(max_load=-1.0)

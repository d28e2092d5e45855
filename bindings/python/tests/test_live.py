"""Live view: recordings of it are read back and compared with the simulation."""

from __future__ import annotations

import importlib.util
import resource
import signal
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import ballast
import numpy as np
import pytest
from ballast import view
from test_remote import Served, down, free_port, served

__all__ = ["served"]

needs_rerun = pytest.mark.skipif(importlib.util.find_spec("rerun") is None, reason="needs the extra rerun")
Values = dict[tuple[str, str], list[tuple[int, Any]]]


def read(path: Path) -> Values:
    """Returns times (ns, 0 without) and values of every component of a recording, by entity and component."""
    from rerun.chunk import RrdReader

    found: Values = defaultdict(list)
    for chunk in RrdReader(path).stream():
        rows = chunk.to_record_batch()
        has_time = "simulated_time" in rows.schema.names
        times = rows.column("simulated_time").cast("int64").to_pylist() if has_time else [0] * chunk.num_rows
        for name in rows.schema.names:
            if ":" in name:
                values = [np.array(row) for row in rows.column(name).to_pylist()]
                found[chunk.entity_path, name.split(":")[1]] += zip(times, values, strict=True)
    return {key: sorted(rows, key=lambda row: row[0]) for key, rows in found.items()}


@needs_rerun
def test_recorded_values_are_those_of_the_simulation(sim: ballast.Simulation, tmp_path: Path) -> None:
    path, tracked = tmp_path / "bed.rrd", [name for name, role in sim.roles.items() if role != "boundary"]
    states, results = [sim.save()], []
    with view.live(sim, path, period_s=0.005, zones=True) as viewer:
        for step in range(1, 78):
            results.append(sim.step_tamping_cycle())
            viewer.update()
            viewer.update()
            if step % 5 == 0:
                states.append(sim.save())
    # The last state is shown, whether it is due or not.
    states.append(sim.save())
    assert (viewer.frames, viewer.dropped_frames) == (17, 0) and repr(viewer) == "LiveView(17 frames, 0 dropped)"
    found = read(path)
    times = [state.time_ns for state in states]
    seen = 0
    for shape in np.unique(sim.shape_indices):
        grains = np.flatnonzero(sim.shape_indices == shape)
        entity = f"/bed/stones/shape_{shape}"
        for component, attribute in (("translations", "positions"), ("quaternions", "orientations")):
            rows = found[entity, component]
            assert [time for time, _ in rows] == times
            for (_, value), state in zip(rows, states, strict=True):
                np.testing.assert_array_equal(value, getattr(state, attribute)[grains].astype(np.float32))
        [(_, corners)], [(_, triangles)] = found[entity, "vertex_positions"], found[entity, "triangle_indices"]
        # Counter-clockwise triangles enclose the volume of the stone.
        volume = sum(np.linalg.det(corners[triangle]) for triangle in triangles) / 6.0
        assert volume == pytest.approx(sim.masses[grains[0]] / 2700.0, rel=1e-4)
        [(_, normals)] = found[entity, "vertex_normals"]
        edges = [corners[triangle[1:]] - corners[triangle[0]] for triangle in triangles]
        assert all(np.cross(*edge) @ normals[t[0]] > 0.0 for edge, t in zip(edges, triangles, strict=True))
        seen += len(grains)
    assert seen == sim.grain_count
    by_time = {result.t1_ns: result for result in results}
    for name in tracked:
        body = f"/bed/bodies/{name}"
        for (time, place), (_, turn), state in zip(
            found[body, "translation"], found[body, "quaternion"], states, strict=True
        ):
            assert time == state.time_ns
            np.testing.assert_allclose(place[0], state.body(name)[0], rtol=1e-6)
            np.testing.assert_allclose(turn[0], state.body(name)[1], rtol=1e-6, atol=1e-7)
        arrows = found[f"/bed/forces/{name}", "vectors"]
        assert [time for time, _ in arrows] == times and arrows[0][1].size == 0
        for time, vector in arrows[1:]:
            np.testing.assert_allclose(vector[0], 2e-5 * by_time[time][name].moving_average_force, rtol=1e-6)
        # Arrows begin at the middle of the upper face, as the body has turned.
        corners = np.vstack([points for points, _ in sim.parts(name)])
        upper = corners[np.isclose(corners[:, 2], corners[:, 2].max())].mean(axis=0)
        for (_, origin), state in zip(found[f"/bed/forces/{name}", "origins"][1:], states[1:], strict=True):
            position, q, _, _ = state.body(name)
            np.testing.assert_allclose(origin[0], position + view.rotation(q) @ upper, rtol=1e-6)
        forces = found[f"/force/{name}", "scalars"]
        assert [time for time, _ in forces] == list(by_time)
        assert [value[0] for _, value in forces] == [np.linalg.norm(r[name].moving_average_force) for r in results]
    assert any(value[0] > 0.0 for _, value in found["/force/tine_1_plus", "scalars"])
    lines = [found[f"/force/{name}", "colors"][0][1][0] for name in tracked]
    assert len(set(lines)) == len(tracked)
    scalars = {
        "/kinetic_energy/stones": [r.energy.kinetic for r in results],
        "/residual/qm16": [r.solver.residual_qm16 for r in results],
        "/iterations/per_step": [r.solver.iterations for r in results],
        "/penetration/largest": [r.solver.max_penetration for r in results],
    }
    for entity, expected in scalars.items():
        assert [value[0] for _, value in found[entity, "scalars"]] == expected
    measured = sim.zones()["under/sleeper_1"]
    zone = found["/compactness/under/sleeper_1", "scalars"]
    assert [time for time, _ in zone] == times[1:] and zone[-1][1][0] == measured.compactness


@needs_rerun
def test_the_view_changes_no_state(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    hashes = []
    for shown in (False, True):
        with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
            viewer = view.live(sim, tmp_path / "bed.rrd", period_s=0.0, zones=True) if shown else None
            for _ in range(20):
                sim.step_tamping_cycle()
                if viewer:
                    viewer.update()
            hashes.append(sim.save().hash)
            if viewer:
                viewer.close()
                viewer.close()
                assert viewer.frames == 21
                with pytest.raises(RuntimeError, match="expected an open view"):
                    viewer.update()
    assert hashes[0] == hashes[1]


@needs_rerun
def test_repeated_windows_and_restored_states(sim: ballast.Simulation, tmp_path: Path) -> None:
    path, h = tmp_path / "bed.rrd", sim.step_ns
    with view.live(sim, path, period_s=0.003) as viewer:
        start, motions = sim.save(), down(sim, 1e-3, 4)
        first = sim.advance_to(4 * h)
        viewer.update()
        again = sim.redo(motions)
        viewer.update()
        # Earlier states are shown at once, as another beginning.
        sim.restore(start)
        viewer.update()
        assert viewer.frames == 4
        last = sim.advance_to(2 * h, zones=True)
        viewer.update()
    found = read(path)
    assert [(time, value[0]) for time, value in found["/kinetic_energy/stones", "scalars"]] == [
        (2 * h, last.energy.kinetic),
        (4 * h, first.energy.kinetic),
        (4 * h, again.energy.kinetic),
    ]
    heights = found["/bed/bodies/tine_1_plus", "translation"]
    assert [time for time, _ in heights] == [0, 0, 2 * h, 4 * h, 4 * h]
    # The repeated window comes after the one that it replaces.
    assert heights[-2][1][0, 2] - heights[-1][1][0, 2] == pytest.approx(1e-3, rel=0.02)
    [(time, value)] = found["/compactness/under/sleeper_1", "scalars"]
    assert (time, value[0]) == (2 * h, last.zones["under/sleeper_1"].compactness)


@needs_rerun
def test_remote_simulations_show_tools_and_forces(served: Served, tmp_path: Path) -> None:
    path, results = tmp_path / "bed.rrd", []
    with served.open() as sim, view.live(sim, path, period_s=0.0) as viewer:
        start = sim.save().commanded_pose("tine_1_plus")[0]
        for _ in range(4):
            results.append(sim.advance_to(sim.now_ns + 5 * sim.step_ns, down(sim, 2e-3, 5)))
            viewer.update()
    found = read(path)
    assert not any(entity.startswith("/bed/stones") for entity, _ in found)
    places = [place[0] for _, place in found["/bed/bodies/tine_1_plus", "translation"]]
    np.testing.assert_allclose(places, [start, *(r["tine_1_plus"].position for r in results)], rtol=1e-6)
    arrows = [vector[0] for _, vector in found["/bed/forces/sleeper_1", "vectors"][1:]]
    np.testing.assert_allclose(arrows, [2e-5 * r["sleeper_1"].moving_average_force for r in results], rtol=1e-6)
    energies = [value[0] for _, value in found["/kinetic_energy/stones", "scalars"]]
    assert energies == [r.energy.kinetic for r in results]


#: Steps a simulation of which a viewer shows every window, and stops the viewer after ten frames.
STALLED = """
import os, signal, subprocess, sys, time
import ballast, ballast.view

serving = "import rerun, time; r = rerun.RecordingStream('viewer'); print(r.serve_grpc(grpc_port={port})); time.sleep(100)"
viewer = subprocess.Popen([sys.executable, "-uc", serving], stdout=subprocess.PIPE, text=True)
address, took = viewer.stdout.readline().strip(), []
with ballast.resume("start.h5", threads=1) as sim:
    shown, start = ballast.view.live(sim, address, period_s=0.0, max_fps=1e6), sim.save()
    window = stopped = 0
    while not stopped or window < stopped + 800:
        window += 1
        if not stopped and shown.frames > 10:
            stopped = window
            os.kill(viewer.pid, signal.SIGSTOP)
        if window % 100 == 0:
            sim.restore(start)
        sim.advance_to(sim.now_ns + sim.step_ns)
        begin = time.perf_counter()
        shown.update()
        took.append(time.perf_counter() - begin)
    shown.close()
print(shown.frames, shown.dropped_frames, sorted(took)[-10])
viewer.kill()
"""


@needs_rerun
def test_a_viewer_that_stops_reading_delays_nothing(sim: ballast.Simulation, tmp_path: Path) -> None:
    sim.save().write(tmp_path / "start.h5")
    program = STALLED.replace("{port}", str(free_port()))
    called = [sys.executable, "-c", program]
    done = subprocess.run(called, capture_output=True, text=True, cwd=tmp_path, timeout=120)
    assert done.returncode == 0, done.stderr
    frames, dropped, slow = done.stdout.split()
    assert int(frames) > 10 and int(dropped) > 500
    assert f"the viewer did not keep up, {dropped} of {int(frames) + int(dropped)} frames were dropped" in done.stderr
    # Ten may wait for a processor that others use.
    assert float(slow) < 0.05


@needs_rerun
def test_frames_per_second_are_limited_for_viewers(sim: ballast.Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    # The recording keeps what it is given.
    monkeypatch.setattr("ballast._live._connect", lambda *_: None)
    with view.live(sim, "rerun+http://viewer/proxy", period_s=0.0, max_fps=1e-3) as viewer:
        for _ in range(20):
            sim.advance_to(sim.now_ns + sim.step_ns)
            viewer.update()
        assert viewer.frames + viewer.dropped_frames == 1


@needs_rerun
def test_incomplete_files_are_reported(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    path, limits = tmp_path / "bed.rrd", resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        with (
            ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim,
            pytest.raises(RuntimeError, match="live view: "),
            view.live(sim, path, period_s=0.0) as viewer,
        ):
            resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
            for _ in range(20):
                sim.advance_to(sim.now_ns + sim.step_ns)
                viewer.update()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)


@needs_rerun
def test_frames_that_cannot_be_sent_end_the_view(
    sim: ballast.Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError("no more")

    viewer = view.live(sim, tmp_path / "bed.rrd", period_s=0.0)
    monkeypatch.setattr(view.LiveView, "_log", fail)
    with pytest.raises(RuntimeError, match="live view: no more"):
        for _ in range(100):
            sim.advance_to(sim.now_ns + sim.step_ns)
            viewer.update()
    with pytest.raises(RuntimeError, match="live view: no more"):
        viewer.close()


def test_a_missing_extra_is_named(sim: ballast.Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(ModuleNotFoundError, match=r"package rerun-sdk, found none; install it: pip install 'ballast\[rerun\]'"):
        view.live(sim, "bed.rrd")


@needs_rerun
def test_invalid_arguments_are_refused(
    sim: ballast.Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "text.rrd").write_text("some words")
    with pytest.raises(FileExistsError, match="text.rrd: expected a new file"):
        view.live(sim, tmp_path / "text.rrd")
    assert (tmp_path / "text.rrd").read_text() == "some words"
    for name, value in (("period_s", -1.0), ("period_s", np.nan), ("max_fps", 0.0), ("max_fps", np.inf)):
        with pytest.raises(ValueError, match=f"{name}: expected .*, found {value}"):
            view.live(sim, tmp_path / "bed.rrd", **{name: value})
    for screen in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(screen, raising=False)
    if sys.platform == "linux":
        with pytest.raises(RuntimeError, match='expected a screen, found none; set `to` to "web" or to a file'):
            view.live(sim)


@needs_rerun
def test_notebooks_show_the_view_in_their_output(sim: ballast.Simulation, tmp_path: Path) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("rerun_notebook")
    sim.save().write(tmp_path / "start.h5")
    lines = (
        "import ballast, ballast.view",
        "sim = ballast.resume('start.h5', threads=1)",
        "with ballast.view.live(sim) as viewer:",
        "    for _ in range(20):",
        "        sim.advance_to(sim.now_ns + sim.step_ns)",
        "        viewer.update()",
        "print(viewer.frames + viewer.dropped_frames)",
    )
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("\n".join(lines))])
    nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = notebook.cells[0].outputs
    assert any("application/vnd.jupyter.widget-view+json" in out.get("data", {}) for out in outputs)
    [printed] = [int(out["text"]) for out in outputs if out.get("name") == "stdout"]
    assert printed >= 2

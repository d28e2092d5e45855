"""Tables, arrays and meshes of a run: the values of its files."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import ballast
import numpy as np
import pytest
from conftest import ROOT, drawing_fault, lowered
from test_tools import arrays_of_page

pytest.importorskip("pandas")
pytest.importorskip("xarray")

from ballast import tables


@pytest.fixture(scope="module")
def run(case: ballast.Case, beds: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a run of the small case, with its recording."""
    program, folder = ROOT / "target/release/ballast", tmp_path_factory.mktemp("run")
    if not program.exists():
        pytest.skip(f"{program} is not built")
    case.write(folder / "tiny.toml")
    called = [program, "run", "tiny.toml", "--out", "out", "--bed-cache", beds, "--record", "out/run.mcap", "--threads", "1"]
    subprocess.run(called, check=True, capture_output=True, cwd=folder)
    return folder / "out"


def test_tables_of_pandas_have_the_columns_of_the_file(run: Path) -> None:
    results = ballast.Results(run / "results.vtkhdf")
    for name in results.tables:
        for source in (results, run, str(run / "results.vtkhdf")):
            table, values = tables.to_pandas(source, name), results.table(name)
            assert table.index.name == "time" and np.array_equal(table.index, values.pop("time"))
            assert list(table) == list(values)
            assert all(np.array_equal(table[column], values[column], equal_nan=True) for column in table)
            assert table.attrs["case"] == "tiny" and set(table.attrs["units"]) == {"time", *table}
    steps = tables.to_pandas(run)
    assert len(steps) == 180 and steps.attrs["units"]["tine_1_plus_force_x"] == "N"
    assert (steps.attrs["units"]["time"], steps.attrs["units"]["iterations"]) == ("s", "1")
    with pytest.raises(KeyError, match="table: expected one of steps, zones, found frames"):
        tables.to_pandas(run, "frames")


def test_arrays_of_steps_and_zones(run: Path) -> None:
    results = ballast.Results(run / "results.vtkhdf")
    steps, table = tables.to_xarray(run), results.table("steps")
    assert list(steps["body"].values) == ["tine_1_plus", "tine_1_minus", "sleeper_1"]
    for body in steps["body"].values:
        for axis in "xyz":
            place = {"body": body, "axis": axis}
            assert np.array_equal(steps["force"].sel(place), table.pop(f"{body}_force_{axis}"))
            assert np.array_equal(steps["position"].sel(place), table.pop(f"{body}_{axis}"))
        assert np.array_equal(steps["work"].sel(body=body), table.pop(f"{body}_work"))
    assert np.array_equal(steps["time"], table.pop("time")) and steps["time"].attrs["units"] == "s"
    assert steps["force"].dims == ("time", "body", "axis")
    assert set(steps) == {"force", "position", "work", *table}
    assert all(np.array_equal(steps[name], values) for name, values in table.items())
    units = {"force": "N", "position": "m", "work": "J", "kinetic": "J", "max_penetration": "m", "contacts": "1"}
    assert {name: steps[name].attrs["units"] for name in units} == units
    zones, table = tables.to_xarray(results, "zones"), results.table("zones")
    assert zones["compactness"].dims == ("time", "zone") and np.array_equal(zones["step"], table.pop("step"))
    assert np.array_equal(zones["time"], table.pop("time")) and list(zones["zone"].values) == list(table)
    for zone, values in table.items():
        assert np.array_equal(zones["compactness"].sel(zone=zone), values, equal_nan=True)
    with pytest.raises(KeyError, match="table: expected one of steps, zones, frames, found nope"):
        tables.to_xarray(run, "nope")


def test_arrays_of_frames(run: Path) -> None:
    results = ballast.Results(run / "results.vtkhdf")
    frames = tables.to_xarray(run, "frames")
    assert frames["position"].shape == (19, results.grain_count + len(results.bodies), 3)
    for frame in (0, 7, 18):
        positions, orientations = results.poses(frame)
        assert np.array_equal(frames["position"][frame], positions)
        assert np.array_equal(frames["orientation"][frame], orientations)
    assert np.array_equal(frames["time"], results.times) and np.array_equal(frames["step"], results.steps)
    # A body has the same name and place in both tables.
    at = {"body": "tine_1_minus", "time": results.times[5]}
    steps = tables.to_xarray(run).sel(at, method=None)
    np.testing.assert_allclose(frames["position"].sel(at), steps["position"], rtol=1e-14)
    assert frames["role"].sel(body="tine_1_minus") == "tine" and frames["role"].sel(body="grain_3") == "grain"
    assert int((frames["role"] == "grain").sum()) == results.grain_count


def test_recordings_have_the_values_of_their_windows(run: Path) -> None:
    windows = [window["result"] for window in ballast.Recording(run / "run.mcap")]
    found = tables.to_xarray(run / "run.mcap")
    assert np.array_equal(found["time"], [w.t1_ns * 1e-9 for w in windows]) and len(windows) == 180
    assert np.array_equal(found["start"], [w.t0_ns * 1e-9 for w in windows])
    for body in windows[0]:
        for name, (unit, _) in tables.OF_BODY.items():
            assert np.array_equal(found[name].sel(body=body), [getattr(w[body], name) for w in windows])
            assert found[name].attrs["units"] == unit
    assert np.array_equal(found["kinetic"], [w.energy.kinetic for w in windows])
    assert np.array_equal(found["visits"], [w.solver.visits for w in windows])
    measured = [i for i, w in enumerate(windows) if w.zones]
    assert 0 < len(measured) < len(windows)
    for zone, values in windows[measured[0]].zones.items():
        compactness = found["compactness"].sel(zone=zone)
        assert compactness[measured[0]] == values.compactness
        assert np.isnan(np.delete(compactness.values, measured)).all()
        assert found["pressure"].sel(zone=zone)[measured[0]] == values.pressure
    # A run and its recording agree.
    steps = tables.to_xarray(run)
    forces = found["mean_force"].sel(body=steps["body"].values)
    np.testing.assert_allclose(forces, steps["force"], rtol=1e-12, atol=1e-12)
    table = tables.to_pandas(run / "run.mcap")
    assert np.array_equal(table["tine_1_plus_mean_force_x"], found["mean_force"].sel(body="tine_1_plus", axis="x"))
    assert np.array_equal(table["sleeper_1_work"], found["work"].sel(body="sleeper_1"))
    assert np.array_equal(table["under/sleeper_1_compactness"], found["compactness"].sel(zone="under/sleeper_1"), equal_nan=True)
    assert np.array_equal(table["kinetic"], found["kinetic"])
    assert table.attrs["units"]["tine_1_plus_mean_force_x"] == "N" and set(table.attrs["units"]) == {"time", *table}
    with pytest.raises(KeyError, match="table: expected windows, found steps"):
        tables.to_pandas(run / "run.mcap", "steps")


def test_recordings_in_windows_and_the_rest_of_one(sim: ballast.Simulation, tmp_path: Path) -> None:
    path, h = tmp_path / "own.mcap", sim.step_ns
    sim.record(path)
    for steps in (3, 1, 4):
        sim.advance_to(sim.now_ns + steps * h, lowered(sim, 1e-3, steps))
    sim.stop_recording()
    recording = ballast.Recording(path)
    whole = tables.to_xarray(recording)
    assert list(whole["steps"].values) == [3, 1, 4] and whole.sizes["zone"] == 0
    assert tables.to_xarray(recording).sizes["time"] == 0
    assert tables.to_pandas(recording).shape[0] == 0
    sim.save().write(tmp_path / "state.h5")
    with pytest.raises(ballast.FileError, match="state.h5: expected results or a recording, found a checkpoint"):
        tables.to_pandas(tmp_path / "state.h5")


def test_tables_without_tools_or_zones(tmp_path: Path, case: ballast.Case, beds: Path) -> None:
    program = ROOT / "target/release/ballast"
    if not program.exists():
        pytest.skip(f"{program} is not built")
    values = case.to_dict()
    for part in ("sleepers", "tines", "tamping"):
        del values[part]
    ballast.Case.from_dict(values).write(tmp_path / "bare.toml")
    called = [program, "run", "bare.toml", "--out", "out", "--bed-cache", beds, "--steps", "3", "--threads", "1"]
    subprocess.run(called, check=True, capture_output=True, cwd=tmp_path)
    steps = tables.to_xarray(tmp_path / "out")
    assert steps["force"].shape == (3, 0, 3) and steps["work"].shape == (3, 0) and steps["kinetic"].shape == (3,)
    assert tables.to_xarray(tmp_path / "out", "zones").sizes["zone"] == 0


def test_frames_are_meshes_of_each_time(run: Path) -> None:
    pytest.importorskip("pyvista")
    from ballast import view

    results = ballast.Results(run / "results.vtkhdf")
    frames = list(view.frames(run))
    assert [time for time, _ in frames] == list(results.times)
    assert list(frames[0][1].keys()) == ["grains", "sleepers", "tines", "boundary", "contacts"]
    first, (x0, q0) = frames[0][1]["grains"], results.poses(0)
    faces = first.regular_faces if first.is_all_triangles else first.irregular_faces
    owner = np.empty(first.n_points, dtype=int)
    for face, body in zip(faces, first["body"], strict=True):
        owner[face] = body
    own = local(first.points, x0, q0, owner)
    for frame in (1, 9, 18):
        mesh, (x, q) = frames[frame][1]["grains"], results.poses(frame)
        # Seen from its own frame, a grain is rigid; meshes of single precision.
        np.testing.assert_allclose(local(mesh.points, x, q, owner), own, atol=1e-6)
        assert mesh["speed"].min() >= 0.0 and frames[frame][1]["contacts"].n_points > 0
    assert np.abs(frames[18][1]["grains"].points - first.points).max() > 1e-3
    assert frames[0][1]["contacts"].n_points == 0
    with pytest.raises(ballast.FileError, match="nowhere"):
        next(view.frames(run / "nowhere"))


def local(points: Any, positions: Any, orientations: Any, owner: Any) -> Any:
    """Returns points in the frames of their bodies, m."""
    from ballast import view

    turns = np.array([view.rotation(q) for q in orientations])
    return np.einsum("nji,nj->ni", turns[owner], points - positions[owner])


#: Draws a frame of results twice, as a picture and as a page.
DRAWING = """
import sys, ballast.view as view
view.save_picture(sys.argv[1], "forces.png", forces=True, frame=9)
view.save_page(sys.argv[1], "speeds.html", frame=9)
"""


def test_pictures_and_pages_of_results(run: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    pytest.importorskip("trame_vtk")
    from ballast import view

    if fault := drawing_fault():
        pytest.skip(f"nothing can be drawn here: {fault}")
    called = [sys.executable, "-c", DRAWING, run]
    done = subprocess.run(called, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "forces.png").stat().st_size > 5000
    arrays = arrays_of_page(tmp_path / "speeds.html", run.name)
    frame = list(view.frames(run))[9][1]
    for name, expected in (("Points", frame["grains"].points), ("speed, m/s", frame["grains"]["speed"])):
        assert any(n == name and np.array_equal(a, expected.ravel()) for n, a in arrays)
    for beyond in (19, -20):
        with pytest.raises(IndexError, match=f"frame: expected -19 to 18, found {beyond}"):
            view.scene(run, frame=beyond)


def test_force_chains_of_results_are_those_of_the_state(run: Path) -> None:
    """The last frame is the state of the checkpoint."""
    pytest.importorskip("pyvista")
    from ballast import view

    with ballast.resume(run, threads=1) as sim:
        expected = view.force_chains(sim)
    _, _, found = view._of_results(run, True, -1)
    assert found.n_cells == expected.n_cells > 0
    # Contact points of results are those of the configuration in which the contacts were found.
    np.testing.assert_allclose(found.points, expected.points, atol=1e-3)
    np.testing.assert_allclose(found["force, N"], expected["force, N"], rtol=1e-6)


def test_a_missing_part_of_the_extra_is_named(
    sim: ballast.Simulation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ballast import view

    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match=r"package trame-vtk, found none; install it: pip install 'ballast\[view\]'"):
        view.save_page(sim, tmp_path / "bed.html")

"""Pictures of simulations and results with pyvista, on or off screen, and a live view with Rerun.

    import ballast.view
    ballast.view.save_picture(sim, "bed.png")
    ballast.view.save_page("runs/first", "bed.html")        # the last frame, to be turned in a browser

Functions with a `source` accept a simulation of this process, the path of a results file, or the folder of a run.
"""

from __future__ import annotations

import html
import importlib
import importlib.util
import io
import json
import os
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import ballast
from ballast._live import LiveView, live, rotation

__all__ = [
    "LiveView",
    "bed",
    "driven_bodies",
    "force_chains",
    "frames",
    "live",
    "rotation",
    "save_page",
    "save_picture",
    "scene",
]

Source = ballast.Simulation | str | os.PathLike[str]


def bed(sim: ballast.Simulation) -> Any:
    """Returns all grains as one `pyvista.PolyData`, with the arrays "speed, m/s" and "grain" on its faces."""
    state, shapes = sim.save(), {}
    speed = np.linalg.norm(state.velocities, axis=1)
    solids, owner = [], []
    for grain, index in enumerate(sim.shape_indices):
        if index not in shapes:
            shapes[index] = sim.shape(int(index))
        corners, polygons = shapes[index]
        placed = corners @ rotation(state.orientations[grain]).T + state.positions[grain]
        solids.append((placed, polygons))
        owner.extend([grain] * len(polygons))
    surface = _surface(solids)
    if owner:
        surface.cell_data["grain"] = np.array(owner)
        surface.cell_data["speed, m/s"] = speed[owner]
    return surface


def driven_bodies(sim: ballast.Simulation) -> Any:
    """Returns all finite driven bodies, such as tines and sleepers, as one `pyvista.PolyData`."""
    state, solids = sim.save(), []
    for name in sim.bodies:
        position, orientation, _, _ = state.body(name)
        turn = rotation(orientation).T
        solids += [(corners @ turn + position, polygons) for corners, polygons in sim.parts(name)]
    return _surface(solids)


def _surface(solids: list[tuple[Any, list[list[int]]]]) -> Any:
    import pyvista as pv

    if not solids:
        return pv.PolyData()
    faces, offset = [], 0
    for corners, polygons in solids:
        for polygon in polygons:
            faces.append(np.array([len(polygon), *polygon]) + [0, *[offset] * len(polygon)])
        offset += len(corners)
    return pv.PolyData(np.vstack([corners for corners, _ in solids]), np.concatenate(faces))


def force_chains(sim: ballast.Simulation, *, threshold: float = 1.0) -> Any:
    """Returns the strongest contacts as lines, with the array "force, N" (`pyvista.PolyData`).

    Lines connect the centres of two grains, or the centre of a grain and its contact point with a driven body.

    Args:
        sim: a simulation of this process.
        threshold: smallest force of a line, as a multiple of the mean over active contacts.
    """
    state = sim.save()
    force = np.linalg.norm(state.contact_impulses, axis=1) / (sim.step_ns * 1e-9)
    return _network(force, state.contact_points, state.contact_bodies, state.positions, threshold)


def _network(force: Any, points: Any, pairs: Any, centres: Any, threshold: float) -> Any:
    """Returns contacts of bodies, of which the first have centres, as lines."""
    import pyvista as pv

    active = force[force > 0.0]
    strong = force > threshold * (active.mean() if len(active) else 0.0)
    if not strong.any():
        return pv.PolyData()
    first, second = pairs[strong].T
    starts, ends = centres[first], points[strong].copy()
    between_grains = second < len(centres)
    ends[between_grains] = centres[second[between_grains]]
    n = len(starts)
    lines = np.column_stack([np.full(n, 2), np.arange(n), np.arange(n) + n])
    network = pv.PolyData(np.vstack([starts, ends]), lines=lines.ravel())
    network.cell_data["force, N"] = force[strong]
    return network


def scene(source: Source, *, forces: bool = False, off_screen: bool = False, frame: int = -1) -> Any:
    """Returns a `pyvista.Plotter` with grains coloured by speed, and translucent driven bodies.

    Args:
        source: a simulation of this process, the path of a results file, or the folder of a run.
        forces: show force chains in translucent grains instead of speeds.
        off_screen: render without a screen.
        frame: number of the frame of results; negative ones count from the end.
    """
    import pyvista as pv

    if isinstance(source, ballast.Simulation):
        surface, driven = bed(source), [driven_bodies(source)]
        network = force_chains(source) if forces else None
    else:
        surface, driven, network = _of_results(source, forces, frame)
    plotter: Any = pv.Plotter(off_screen=off_screen)
    if network is not None:
        # Nearly transparent: about twenty grains overlap in a line of sight.
        plotter.add_mesh(surface, color="grey", opacity=0.03)
        if network.n_cells:
            plotter.add_mesh(
                network,
                scalars="force, N",
                cmap="plasma_r",
                line_width=5,
                render_lines_as_tubes=True,
                scalar_bar_args=_bar("force, N", "%.0f"),
            )
    elif surface.n_cells:
        name = "speed, m/s"
        plotter.add_mesh(
            surface,
            scalars=name,
            cmap="viridis",
            clim=[0.0, max(float(surface[name].max()), 1e-6)],
            scalar_bar_args=_bar(name, "%.3g"),
        )
    for mesh in driven:
        if mesh.n_cells:
            plotter.add_mesh(mesh, color="steelblue", opacity=0.15 if forces else 0.5)
    plotter.view_vector((0.4, -1.0, 0.35), viewup=(0.0, 0.0, 1.0))
    return plotter


def _of_results(run: str | os.PathLike[str], forces: bool, frame: int) -> tuple[Any, list[Any], Any]:
    frames = _Frames(run)
    results, blocks = frames.results, frames.blocks(frame)
    surface, contacts = blocks["grains"], blocks["contacts"]
    surface.cell_data["speed, m/s"] = surface.cell_data["speed"]
    network = None
    if forces:
        force = np.linalg.norm(contacts["force"].reshape(-1, 3), axis=1)
        pairs = np.column_stack([contacts["candidate"], contacts["antagonist"]]).astype(int)
        centres = results.poses(frame)[0][: results.grain_count]
        network = _network(force, contacts.points.astype(float), pairs, centres, 1.0)
    return surface, [blocks[name] for name in ("sleepers", "tines", "plates") if name in blocks.keys()], network


def _bar(title: str, form: str) -> dict[str, Any]:
    # The empty line separates the title from the numbers; the position keeps them inside the picture.
    return {"title": f"{title}\n", "fmt": form, "position_x": 0.2, "width": 0.6}


def frames(run: str | os.PathLike[str]) -> Iterator[tuple[float, Any]]:
    """Yields the time (s) and the blocks (`pyvista.MultiBlock`) of each frame of a results file.

    The blocks are "grains", "sleepers", "tines", "plates", "boundary" and "contacts", those that are not empty;
    docs/src/guide/results.md lists their arrays.

        for time, blocks in ballast.view.frames("runs/first"):
            print(time, blocks["grains"]["speed"].max())

    Args:
        run: path of the results, or of the folder of a run.

    Raises:
        FileError: the file cannot be read.
    """
    source = _Frames(run)
    for frame, time in enumerate(source.results.times):
        yield float(time), source.blocks(frame)


class _Frames:
    """Frames of a results file, of which readers of pyvista would read the first only."""

    def __init__(self, run: str | os.PathLike[str]) -> None:
        from vtkmodules.vtkIOHDF import vtkHDFReader

        path = ballast._run_file(run, "results.vtkhdf")
        self.results = ballast.Results(path)
        self._reader = vtkHDFReader()
        self._reader.SetFileName(os.fspath(path))
        self._reader.UpdateInformation()

    def blocks(self, frame: int) -> Any:
        import pyvista as pv

        count = len(self.results.times)
        if not -count <= frame < count:
            raise IndexError(f"frame: expected {-count} to {count - 1}, found {frame}")
        self._reader.SetStep(frame % count)
        self._reader.Update()
        return pv.wrap(self._reader.GetOutputDataObject(0)).copy()


def save_picture(
    source: Source, path: str | os.PathLike[str], *, forces: bool = False, frame: int = -1
) -> None:
    """Writes a picture of `scene` to an image file; needs no screen."""
    plotter = scene(source, forces=forces, off_screen=True, frame=frame)
    try:
        plotter.screenshot(os.fspath(path))
    finally:
        plotter.close()


def save_page(
    source: Source, path: str | os.PathLike[str], *, forces: bool = False, frame: int = -1
) -> None:
    """Writes `scene` to an HTML page that shows it in 3D, without other files and without a network.

    Raises:
        ModuleNotFoundError: the extra `view` is not installed.
    """
    if importlib.util.find_spec("trame_vtk") is None:
        text = "expected the package trame-vtk, found none; install it: pip install 'ballast[view]'"
        raise ModuleNotFoundError(f"ballast.view.save_page: {text}", name="trame_vtk")
    plotter = scene(source, forces=forces, off_screen=True, frame=frame)
    try:
        packed = _for_browser(plotter.render_window)
    finally:
        plotter.close()
    page = io.StringIO()
    importlib.import_module("trame_vtk.tools.vtksz2html").write_html(packed, page)
    title = html.escape(source.case.name if isinstance(source, ballast.Simulation) else Path(source).name)
    text = re.sub("<title>.*?</title>", lambda _: f"<title>{title}</title>", page.getvalue(), count=1)
    Path(path).write_text(text)


def _for_browser(window: Any) -> bytes:
    """Returns a scene in the format of vtk.js, zipped.

    The export of pyvista starts a server for this, and in a notebook downloads a renderer that the page does not use.
    """
    serializers = importlib.import_module("trame_vtk.modules.vtk.serializers")
    serializers.initialize_serializers()
    context = serializers.SynchronizationContext()
    context.set_ignore_last_dependencies(True)
    shown = serializers.serialize(None, window, serializers.reference_id(window), context, 1)
    camera = window.GetRenderers().GetFirstRenderer().GetActiveCamera()
    shown["extra"] = {
        "vtkRefId": serializers.reference_id(window),
        "centerOfRotation": camera.GetFocalPoint(),
        "camera": serializers.reference_id(camera),
    }
    arrays = {
        entry["hash"]: entry | {"content": context.get_cached_data_array(entry["hash"])}
        for entry in serializers.extract_array_hash(shown)
    }
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("index.json", json.dumps({"hashes": arrays, "scene": shown}))
    return packed.getvalue()

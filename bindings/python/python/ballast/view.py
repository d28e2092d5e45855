"""Pictures of a simulation with pyvista, on or off screen, and a live view with Rerun.

    import ballast.view
    ballast.view.save_picture(sim, "bed.png")
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Any

import numpy as np

import ballast
from ballast._live import LiveView, live

__all__ = ["LiveView", "bed", "driven_bodies", "force_chains", "frames", "live", "rotation", "save_picture", "scene"]


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
    import pyvista as pv

    state = sim.save()
    force = np.linalg.norm(state.contact_impulses, axis=1) / (sim.step_ns * 1e-9)
    active = force[force > 0.0]
    strong = force > threshold * (active.mean() if len(active) else 0.0)
    if not strong.any():
        return pv.PolyData()
    ends = state.contact_points[strong]
    starts = state.positions[state.contact_bodies[strong, 0]]
    pairs = state.contact_bodies[strong, 1]
    between_grains = pairs < sim.grain_count
    ends = ends.copy()
    ends[between_grains] = state.positions[pairs[between_grains]]
    n = len(starts)
    lines = np.column_stack([np.full(n, 2), np.arange(n), np.arange(n) + n])
    network = pv.PolyData(np.vstack([starts, ends]), lines=lines.ravel())
    network.cell_data["force, N"] = force[strong]
    return network


def scene(sim: ballast.Simulation, *, forces: bool = False, off_screen: bool = False) -> Any:
    """Returns a `pyvista.Plotter` with grains coloured by speed, and translucent driven bodies.

    Args:
        sim: a simulation of this process.
        forces: show force chains in translucent grains instead of speeds.
        off_screen: render without a screen.
    """
    import pyvista as pv

    plotter: Any = pv.Plotter(off_screen=off_screen)
    surface = bed(sim)
    if forces:
        # Nearly transparent: about twenty grains overlap in a line of sight.
        plotter.add_mesh(surface, color="grey", opacity=0.03)
        network = force_chains(sim)
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
    driven = driven_bodies(sim)
    if driven.n_cells:
        plotter.add_mesh(driven, color="steelblue", opacity=0.15 if forces else 0.5)
    plotter.view_vector((0.4, -1.0, 0.35), viewup=(0.0, 0.0, 1.0))
    return plotter


def _bar(title: str, form: str) -> dict[str, Any]:
    # The empty line separates the title from the numbers; the position keeps them inside the picture.
    return {"title": f"{title}\n", "fmt": form, "position_x": 0.2, "width": 0.6}


def frames(run: str | os.PathLike[str]) -> Iterator[tuple[float, Any]]:
    """Yields the time (s) and the blocks (`pyvista.MultiBlock`) of each frame of a results file.

    The blocks are "grains", "sleepers", "tines", "boundary" and "contacts"; docs/src/guide/results.md lists their arrays.

        for time, blocks in ballast.view.frames("runs/first"):
            print(time, blocks["grains"]["speed"].max())

    Args:
        run: path of the results, or of the folder of a run.

    Raises:
        FileError: the file cannot be read.
    """
    import pyvista as pv
    from vtkmodules.vtkIOHDF import vtkHDFReader

    path = ballast._run_file(run, "results.vtkhdf")
    times = ballast.Results(path).times
    # Readers of pyvista do not select times of this format.
    reader = vtkHDFReader()
    reader.SetFileName(os.fspath(path))
    reader.UpdateInformation()
    for frame, time in enumerate(times):
        reader.SetStep(frame)
        reader.Update()
        yield float(time), pv.wrap(reader.GetOutputDataObject(0)).copy()


def save_picture(
    sim: ballast.Simulation, path: str | os.PathLike[str], *, forces: bool = False
) -> None:
    """Writes a picture of `scene` to an image file; needs no screen."""
    plotter = scene(sim, forces=forces, off_screen=True)
    try:
        plotter.screenshot(os.fspath(path))
    finally:
        plotter.close()


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

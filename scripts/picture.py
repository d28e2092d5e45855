#!/usr/bin/env python3
"""Draws a run before and during tamping: python3 scripts/picture.py RESULTS.vtkhdf OUT.png [FRAME]

Needs vtk 9.4 or later and pyvista. Colours show the speed of the grains.
"""
import sys

import pyvista
import vtk


def frame(path, number):
    """The blocks of one frame: grains, sleepers, tines, boundary, contacts."""
    reader = vtk.vtkHDFReader()
    reader.SetFileName(path)
    reader.UpdateInformation()
    reader.SetStep(min(number, reader.GetNumberOfSteps() - 1))
    reader.Update()
    blocks = pyvista.wrap(reader.GetOutputDataObject(0))
    return {name: blocks[blocks.get_index_by_name(name)] for name in ("grains", "sleepers", "tines")}


def main(path, out, number):
    pyvista.OFF_SCREEN = True
    plotter = pyvista.Plotter(shape=(1, 2), window_size=(1500, 620), border=False)
    for column, (title, step) in enumerate((("at the start", 0), (f"frame {number}", number))):
        blocks = frame(path, step)
        plotter.subplot(0, column)
        plotter.add_mesh(
            blocks["grains"],
            scalars="speed",
            cmap="YlOrRd",
            clim=[0, 0.5],
            show_scalar_bar=column == 1,
            # An empty line keeps the title off the numbers.
            scalar_bar_args={"title": "speed (m/s)\n", "width": 0.5, "height": 0.1, "position_y": 0.01},
        )
        plotter.add_mesh(blocks["sleepers"], color="lightgrey")
        plotter.add_mesh(blocks["tines"], color="steelblue")
        plotter.add_text(title, font_size=12)
        plotter.camera_position = [(0.62, -0.75, 0.5), (0.18, 0.12, 0.12), (0, 0, 1)]
    plotter.screenshot(out)


if __name__ == "__main__":
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    main(sys.argv[1], sys.argv[2], int(sys.argv[3]) if len(sys.argv) == 4 else 45)

"""Reads a results file with VTK's own reader and prints one fact per line."""

import sys

import vtk
from vtk.util.numpy_support import vtk_to_numpy


def report(frame, name, data):
    points, polys, verts = data.GetNumberOfPoints(), data.GetNumberOfPolys(), data.GetNumberOfVerts()
    print(f"{frame} {name} points {points} polygons {polys} vertices {verts}")
    if points:
        corner = vtk_to_numpy(data.GetPoints().GetData())[-1]
        print(f"{frame} {name} last {' '.join(repr(float(c)) for c in corner)}")
    for on in (data.GetCellData(), data.GetPointData()):
        for k in range(on.GetNumberOfArrays()):
            values = vtk_to_numpy(on.GetArray(k)).astype("f8")
            print(f"{frame} {name} {on.GetArrayName(k)} {values.size} {float(values.sum())!r}")
    if polys:
        mass = vtk.vtkMassProperties()
        triangles = vtk.vtkTriangleFilter()
        triangles.SetInputData(data)
        mass.SetInputConnection(triangles.GetOutputPort())
        mass.Update()
        print(f"{frame} {name} volume {mass.GetVolume()!r}")


def collection(path):
    reader = vtk.vtkHDFReader()
    reader.SetFileName(path)
    assert reader.CanReadFile(path)
    reader.UpdateInformation()
    print(f"steps {reader.GetNumberOfSteps()}")
    for frame in range(reader.GetNumberOfSteps()):
        reader.SetStep(frame)
        reader.Update()
        print(f"{frame} time {reader.GetTimeValue()!r}")
        blocks = reader.GetOutputDataObject(0)
        for k in range(blocks.GetNumberOfBlocks()):
            name = blocks.GetMetaData(k).Get(vtk.vtkCompositeDataSet.NAME())
            report(frame, name, blocks.GetBlock(k))


def polydata(path):
    reader = vtk.vtkXMLPolyDataReader()
    reader.SetFileName(path)
    reader.Update()
    assert reader.GetErrorCode() == 0
    report(0, "file", reader.GetOutput())


for path in sys.argv[1:]:
    (polydata if path.endswith(".vtp") else collection)(path)

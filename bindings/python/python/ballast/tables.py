"""Results and recordings as tables of pandas and arrays of xarray, with their units.

    from ballast import tables

    steps = tables.to_pandas("runs/first")                  # a row for each step
    forces = tables.to_xarray("runs/first")["force"]        # time, body, axis
    forces.sel(body="tine_1_plus", axis="z").plot()

Functions accept `Results`, a `Recording`, the path of either, or the folder of a run, which stands for its results. The
index is the time, s since the start of the run. Units are in `attrs["units"]`: of a table by column, of an array its unit.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

import ballast

if TYPE_CHECKING:
    import pandas
    import xarray

Run = ballast.Results | ballast.Recording | str | os.PathLike[str]

AXES, COMPONENTS = ["x", "y", "z"], ["x", "y", "z", "w"]
#: Values of the windows of a recording by body, with unit and third dimension.
OF_BODY = {
    "mean_force": ("N", "axis"),
    "mean_torque": ("N m", "axis"),
    "peak_force": ("N", "axis"),
    "work": ("J", None),
    "position": ("m", "axis"),
    "orientation": ("1", "component"),
    "velocity": ("m/s", "axis"),
    "angular_velocity": ("rad/s", "axis"),
}
OF_ENERGY = {name: "J" for name in ("kinetic", "potential", "elastic", "external_work", "dissipated", "balance_error")}
OF_SOLVER = {
    "iterations": "1",
    "visits": "1",
    "steps_not_converged": "1",
    "residual_qm16": "1",
    "residual_natural_map": "1",
    "contacts": "1",
    "active_contacts": "1",
    "mean_penetration": "m",
    "max_penetration": "m",
    "force_difference": "N s",
    "force_compared": "N s",
    "complementarity_gap": "J",
    "infeasible_work": "J",
}
OF_ZONE = {"compactness": "1", "coordination": "1", "inertial_number": "1", "pressure": "Pa"}


def to_pandas(run: Run, table: str | None = None) -> pandas.DataFrame:
    """Returns a table of results, or the windows of a recording, as a `pandas.DataFrame` over the time.

    Columns of results have the names of docs/src/guide/results.md. Those of recordings join the names of body or zone,
    quantity and axis, such as "tine_1_plus_mean_force_x", "kinetic" and "under/sleeper_1_compactness".

    Args:
        run: results, a recording, the path of either, or the folder of a run.
        table: "steps" (default) or "zones" of results, "windows" of a recording.

    Raises:
        FileError: the file cannot be read.
        KeyError: there is no such table.
    """
    import pandas as pd

    source = _source(run)
    if isinstance(source, ballast.Recording):
        return _flattened(_windows(source, table))
    name = table or "steps"
    values, units = source.table(name), source.units(name)
    frame = pd.DataFrame(values).set_index("time")
    frame.attrs = {"case": source.case_name, "units": {column: units.get(column) or "1" for column in values}}
    return frame


def to_xarray(run: Run, table: str | None = None) -> xarray.Dataset:
    """Returns a table of results, or the windows of a recording, as an `xarray.Dataset`.

    Dimensions are "time", "body" and "zone" (names as coordinates), "axis" (x, y, z) and "component" (x, y, z, w).

    | table | variables |
    |---|---|
    | "steps" (default) | force, position and work of tines and sleepers; the columns that belong to no body |
    | "zones" | compactness |
    | "frames" | position and orientation of all bodies; grains are "grain_0" and so on, and "role" tells what a body is |
    | "windows" (a recording) | values of `BodyResult`, `EnergyLedger` and `SolverResult`, and of zones where they were measured |

    Args:
        run: results, a recording, the path of either, or the folder of a run. Of a recording the windows that were not
            read before.
        table: name of the table.

    Raises:
        FileError: the file cannot be read.
        KeyError: there is no such table.
    """
    source = _source(run)
    if isinstance(source, ballast.Recording):
        return _windows(source, table)
    if table == "frames":
        return _frames(source)
    name = table or "steps"
    if name not in source.tables:
        raise KeyError(f"table: expected one of {', '.join([*source.tables, 'frames'])}, found {name}")
    return _zones(source) if name == "zones" else _steps(source, name)


def _source(run: Run) -> ballast.Results | ballast.Recording:
    if isinstance(run, ballast.Results | ballast.Recording):
        return run
    source = ballast.read(run)
    if isinstance(source, ballast.State):
        raise ballast.FileError(f"{os.fspath(run)}: expected results or a recording, found a checkpoint")
    return source


def _dataset(
    variables: Mapping[str, tuple[tuple[str, ...], Any, str]], coordinates: Mapping[str, Any], case: str
) -> xarray.Dataset:
    """Returns a dataset of variables with dimensions, values and unit."""
    import xarray as xr

    data = {name: (dims, values, {"units": unit}) for name, (dims, values, unit) in variables.items()}
    dataset = xr.Dataset(data, dict(coordinates), {"case": case})
    dataset["time"].attrs = {"units": "s", "long_name": "time"}
    return dataset


def _steps(results: ballast.Results, name: str) -> xarray.Dataset:
    table, units = results.table(name), results.units(name)
    bodies, rows = [body for body in results.bodies if f"{body}_work" in table], len(table["time"])
    variables: dict[str, tuple[tuple[str, ...], Any, str]] = {}
    for quantity, suffix, unit in (("force", "_force", "N"), ("position", "", "m")):
        columns = [[table.pop(f"{body}{suffix}_{axis}") for axis in AXES] for body in bodies]
        values = np.array(columns).reshape(len(bodies), 3, rows)
        variables[quantity] = (("time", "body", "axis"), np.moveaxis(values, 2, 0), unit)
    work = np.array([table.pop(f"{body}_work") for body in bodies]).reshape(len(bodies), rows)
    variables["work"] = (("time", "body"), work.T, "J")
    time = table.pop("time")
    variables |= {column: (("time",), values, units.get(column) or "1") for column, values in table.items()}
    return _dataset(variables, {"time": time, "body": bodies, "axis": AXES}, results.case_name)


def _zones(results: ballast.Results) -> xarray.Dataset:
    table = results.table("zones")
    step, time = table.pop("step"), table.pop("time")
    values = np.array(list(table.values())).reshape(len(table), len(time)).T
    variables = {"compactness": (("time", "zone"), values, "1"), "step": (("time",), step, "1")}
    return _dataset(variables, {"time": time, "zone": list(table)}, results.case_name)


def _frames(results: ballast.Results) -> xarray.Dataset:
    grains, bodies = results.grain_count, results.bodies
    names = [f"grain_{grain}" for grain in range(grains)] + bodies
    roles = ["grain"] * grains + [results.roles[body] for body in bodies]
    positions = np.empty((len(results.times), len(names), 3))
    orientations = np.empty((len(results.times), len(names), 4))
    for frame in range(len(results.times)):
        positions[frame], orientations[frame] = results.poses(frame)
    variables = {
        "position": (("time", "body", "axis"), positions, "m"),
        "orientation": (("time", "body", "component"), orientations, "1"),
        "step": (("time",), results.steps, "1"),
    }
    coordinates = {"time": results.times, "body": names, "axis": AXES, "component": COMPONENTS, "role": ("body", roles)}
    return _dataset(variables, coordinates, results.case_name)


def _windows(recording: ballast.Recording, table: str | None) -> xarray.Dataset:
    if table not in (None, "windows"):
        raise KeyError(f"table: expected windows, found {table}")
    results = [window["result"] for window in recording]
    bodies = list(results[0]) if results else []
    zones = list(dict.fromkeys(zone for result in results for zone in result.zones))
    variables: dict[str, tuple[tuple[str, ...], Any, str]] = {
        "start": (("time",), _numbers(result.t0_ns * 1e-9 for result in results), "s"),
        "steps": (("time",), np.array([result.steps for result in results], dtype=np.int64), "1"),
    }
    for name, (unit, last) in OF_BODY.items():
        values = np.array([[getattr(result[body], name) for body in bodies] for result in results])
        shape = (len(results), len(bodies), *([] if last is None else [3 if last == "axis" else 4]))
        variables[name] = (("time", "body", *([] if last is None else [last])), values.reshape(shape), unit)
    for part, names in (("energy", OF_ENERGY), ("solver", OF_SOLVER)):
        for name, unit in names.items():
            variables[name] = (("time",), np.array([getattr(getattr(r, part), name) for r in results]), unit)
    for name, unit in OF_ZONE.items():
        measured = (getattr(r.zones[zone], name) if zone in r.zones else None for r in results for zone in zones)
        variables[name] = (("time", "zone"), _numbers(measured).reshape(len(results), len(zones)), unit)
    coordinates = {"time": _numbers(result.t1_ns * 1e-9 for result in results), "body": bodies, "zone": zones}
    return _dataset(variables, coordinates | {"axis": AXES, "component": COMPONENTS}, recording.case.name)


def _numbers(values: Iterable[float | None]) -> Any:
    """Returns numbers as an array, without a value as not a number."""
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _flattened(dataset: xarray.Dataset) -> pandas.DataFrame:
    """Returns a dataset as a table with a column for each body or zone, quantity and axis."""
    import pandas as pd

    columns, units = {}, {"time": "s"}
    for name, variable in dataset.data_vars.items():
        labels = [[str(label) for label in dataset[dim].values] for dim in variable.dims[1:]]
        for at in np.ndindex(*variable.shape[1:]):
            chosen = [part[i] for part, i in zip(labels, at, strict=True)]
            column = "_".join([*chosen[:1], str(name), *chosen[1:]])
            columns[column] = variable.values[(slice(None), *at)]
            units[column] = variable.attrs["units"]
    frame = pd.DataFrame(columns, index=pd.Index(dataset["time"].values, name="time"))
    frame.attrs = {"case": dataset.attrs["case"], "units": units}
    return frame

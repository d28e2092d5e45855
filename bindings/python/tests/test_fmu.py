"""Co-simulation units of the small case in FMPy, an importer of both versions of FMI."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import ballast
import numpy as np
import pytest

pytest.importorskip("fmpy")

import fmpy
from fmpy.util import read_csv
from fmpy.validation import validate_fmu
from fmu_process import STEP, advance

VERSIONS = [2, 3]
TINE = "tine_1_plus"


@pytest.mark.parametrize("version", VERSIONS)
def test_a_unit_is_valid(units: dict[int, Path], version: int) -> None:
    assert validate_fmu(units[version]) == []
    description = fmpy.read_model_description(units[version])
    assert description.coSimulation.canGetAndSetFMUstate and description.coSimulation.canSerializeFMUstate
    bodies = {v.name.split(".")[0] for v in description.modelVariables if v.name.endswith(".force[1]")}
    assert bodies == {"sleeper_1", "tine_1_minus", "tine_1_plus"}
    for variable in description.modelVariables:
        assert variable.description or variable.name == "time"
        if ".force" in variable.name:
            assert variable.unit == "N" and "by the ballast on the body" in variable.description


@pytest.mark.parametrize("version", VERSIONS)
def test_the_library_needs_no_hdf5(units: dict[int, Path], version: int, tmp_path: Path) -> None:
    fmpy.extract(units[version], tmp_path)
    [library] = tmp_path.glob("binaries/*/ballast_fmu.*")
    linked = subprocess.run(["ldd", library], capture_output=True, text=True, check=True).stdout
    assert "hdf5" not in linked and "not found" not in linked


def test_inputs_from_csv_give_equal_results(units: dict[int, Path], tmp_path: Path) -> None:
    start = fmpy.read_model_description(units[2])
    x, y, z = (
        float(next(v.start for v in start.modelVariables if v.name == f"{TINE}.position[{k}]")) for k in (1, 2, 3)
    )
    names = [f"{TINE}.position[{k}]" for k in (1, 2, 3)] + [f"{TINE}.velocity[3]"]
    rows = [[t, x, y, z - 0.3 * t, -0.3] for t in np.linspace(0.0, 0.1, 21)]
    table = tmp_path / "inputs.csv"
    lines = [",".join(['"time"', *(f'"{name}"' for name in names)])]
    table.write_text("\n".join(lines + [",".join(map(repr, map(float, row))) for row in rows]) + "\n")
    outputs = [f"{TINE}.force[3]", f"{TINE}.body_position[3]"]
    results = [
        fmpy.simulate_fmu(
            units[version], stop_time=0.1, output_interval=0.005, input=read_csv(table), output=outputs,
            start_values={"inputs_at": 2}, fmi_call_logger=None,
        )
        for version in VERSIONS
    ]  # fmt: skip
    for output in outputs:
        np.testing.assert_array_equal(results[0][output], results[1][output])
    # The blade lags by the deflection of its shaft.
    assert abs(results[0][outputs[1]][-1] - (z - 0.3 * 0.1)) < 1e-2
    assert np.abs(results[0][outputs[0]]).max() > 1.0


@pytest.mark.parametrize("version", VERSIONS)
def test_a_state_continues_in_another_process(units: dict[int, Path], version: int, tmp_path: Path) -> None:
    whole, _ = advance(units[version], 0, 8)
    _, state = advance(units[version], 0, 3)
    saved = tmp_path / "state"
    saved.write_bytes(state)
    program = [sys.executable, Path(__file__).with_name("fmu_process.py"), units[version], "3", "8", saved]
    done = subprocess.run([*map(str, program)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == whole


def test_a_unit_gives_the_states_of_the_package(
    units: dict[int, Path], case: ballast.Case, beds: Path
) -> None:
    with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
        position, orientation = sim.save().commanded_pose(TINE)
        for step in range(4):
            times = [sim.now_ns, sim.now_ns + round(STEP * 1e9)]
            heights = [position[2] - 0.2 * STEP * k for k in (step, step + 1)]
            positions = [[position[0], position[1], height] for height in heights]
            speeds = [[0.0, 0.0, -0.2 if k else 0.0] for k in (step, step + 1)]
            motion = ballast.Motion(times, positions, [orientation] * 2, velocities=speeds)
            sim.advance_to(times[1], {TINE: motion})
        expected = sim.save().hash
    assert {advance(unit, 0, 4)[0] for unit in units.values()} == {expected}

"""Co-simulation units and a mass on a spring, a unit from another source, in several importers.

A parallel master steps both units with the outputs of the last step; a sequential one steps the mass first, and the ballast
follows its motion.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import ballast
import numpy as np
import pytest
from conftest import ROOT
from spring_mass import write_unit

pytest.importorskip("fmpy")

import fmpy
from fmpy.validation import validate_fmu
from fmu_instance import Instance

TINE = "tine_1_plus"
POSITION, VELOCITY, FORCE = f"{TINE}.position[3]", f"{TINE}.velocity[3]", f"{TINE}.force[3]"
#: Communication step, s; number of steps.
STEP, STEPS = 1e-3, 60
STEP_NS = round(STEP * 1e9)

#: Position of the mass and force on the tine after each step (n, 2), and hash of the last state.
Outcome = tuple[np.ndarray, str]


@pytest.fixture(scope="module")
def spring(machine_units: dict[int, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Unit of a mass on a spring, at the height of the tine."""
    path = tmp_path_factory.mktemp("spring") / "spring.fmu"
    description = fmpy.read_model_description(machine_units[2])
    write_unit(path, float(next(v.start for v in description.modelVariables if v.name == POSITION)), STEP)
    return path


@pytest.fixture(scope="module")
def run_master(machine_units: dict[int, Path], spring: Path) -> Callable[..., Outcome]:
    """Master in FMPy: version of FMI, "parallel" or "sequential", time at which inputs hold, length of each step."""

    @cache
    def run(version: int, order: str, inputs_at: int, length: Callable[[int], float] = lambda k: STEP) -> Outcome:
        rows = []
        with Instance(machine_units[version], {"inputs_at": inputs_at, "threads": 1}) as bed, Instance(spring) as mass:
            for k in range(STEPS):
                motion = {POSITION: mass.get("position"), VELOCITY: mass.get("velocity")}
                mass.set({"force": bed.get(FORCE)})
                mass.fmu.doStep(k * STEP, length(k))
                if order == "sequential":
                    motion = {POSITION: mass.get("position"), VELOCITY: mass.get("velocity")}
                bed.set(motion)
                bed.fmu.doStep(k * STEP, length(k))
                rows.append((mass.get("position"), bed.get(FORCE)))
            found = np.array(rows)
            assert np.abs(found[:, 1]).max() > 100.0, "the tine touches no stone"
            return found, bed.get("state_hash")

    return run


def motions(state: ballast.State, position: float, velocity: float) -> dict[str, ballast.Motion]:
    """Returns the motion of the tine in a window from a state to a height (m) with a velocity (m/s)."""
    (start, orientation), twist = state.commanded_pose(TINE), state.commanded_twist(TINE)
    assert twist is not None
    times, positions = [state.time_ns, state.time_ns + STEP_NS], [start, [*start[:2], position]]
    return {TINE: ballast.Motion(times, positions, [orientation] * 2, velocities=[twist[0], [0.0, 0.0, velocity]])}


def test_both_versions_follow_a_spring_mass_unit(
    machine_units: dict[int, Path], spring: Path, machine_case: ballast.Case, beds: Path, run_master: Callable[..., Outcome]
) -> None:
    """The package, coupled to the same mass, has the state of the units."""
    assert validate_fmu(spring) == []
    forces = []
    with ballast.open(machine_case, bed_cache=beds, threads=1, progress=False) as sim, Instance(spring) as mass:
        force = 0.0
        for k in range(STEPS):
            mass.set({"force": force})
            mass.fmu.doStep(k * STEP, STEP)
            motion = motions(sim.save(), mass.get("position"), mass.get("velocity"))
            force = float(sim.advance_to(sim.now_ns + STEP_NS, motion)[TINE].mean_force[2])
            forces.append(force)
        expected = sim.save().hash
    for version in machine_units:
        found, state_hash = run_master(version, "sequential", 1)
        assert state_hash == expected
        np.testing.assert_array_equal(found[:, 1], forces)


def tool(name: str, *arguments: object) -> str:
    """Runs a program of the environment and returns what it prints."""
    program = [Path(sys.executable).with_name(name), *arguments]
    done = subprocess.run([*map(str, program)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.mark.parametrize("version", [2, 3])
def test_the_manipulation_toolbox_finds_units_compliant(units: dict[int, Path], version: int) -> None:
    pytest.importorskip("fmu_manipulation_toolbox")
    printed = tool("fmutool", "-input", units[version], "-check")
    assert f"compliant with FMI-{version}.0" in printed and f"No semantic error against the FMI-{version}" in printed
    assert "ERROR" not in printed


@pytest.mark.parametrize("version", [2, 3])
def test_a_container_wires_the_units(
    machine_units: dict[int, Path], spring: Path, version: int, tmp_path: Path, run_master: Callable[..., Outcome]
) -> None:
    """The container of the manipulation toolbox is a parallel master."""
    pytest.importorskip("fmu_manipulation_toolbox")
    bed, mass = str(machine_units[version]), str(spring)
    plan = {
        "name": "press.fmu", "fmu": [mass, bed], "step_size": STEP,
        "link": [[mass, "position", bed, POSITION], [mass, "velocity", bed, VELOCITY], [bed, FORCE, mass, "force"]],
        "output": [[mass, "position", "position"], [bed, FORCE, "force"]],
        "start": [[bed, "inputs_at", "2"], [bed, "threads", "1"]],
    }  # fmt: skip
    (tmp_path / "press.json").write_text(json.dumps(plan))
    quiet = ["-no-auto-input", "-no-auto-link", "-no-auto-output"]
    tool("fmucontainer", "-container", tmp_path / "press.json", "-fmu-directory", tmp_path, "-fmi", version, *quiet)
    done = fmpy.simulate_fmu(
        tmp_path / "press.fmu", stop_time=STEP * STEPS, output_interval=STEP, output=["position", "force"]
    )
    expected, _ = run_master(version, "parallel", 2)
    np.testing.assert_array_equal(np.stack([done["position"], done["force"]], axis=1)[1:], expected)


def test_libcosim_steps_the_units(machine_units: dict[int, Path], spring: Path, run_master: Callable[..., Outcome]) -> None:
    """libcosim is a parallel master for FMI 2."""
    pytest.importorskip("libcosimpy")
    from libcosimpy.CosimEnums import CosimExecutionState
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.ERROR)
    variables = fmpy.read_model_description(machine_units[2]).modelVariables
    references = {v.name: v.valueReference for v in variables}
    execution = CosimExecution.from_step_size(round(STEP * 1e9))
    bed, mass = (execution.add_local_slave(CosimLocalSlave(str(p), n)) for p, n in ((machine_units[2], "bed"), (spring, "mass")))
    values = CosimObserver.create_last_value()
    assert execution.add_observer(values)
    assert execution.integer_initial_value(bed, references["threads"], 1)
    assert execution.integer_initial_value(bed, references["inputs_at"], 2)
    links = [(mass, 1, bed, references[POSITION]), (mass, 2, bed, references[VELOCITY]), (bed, references[FORCE], mass, 0)]
    for link in links:
        assert execution.connect_real_variables(*link) == 0
    rows = []
    for _ in range(STEPS):
        assert execution.step()
        rows.append(values.last_real_values(mass, [1]) + values.last_real_values(bed, [references[FORCE]]))
    # It passes the differences of its times.
    expected, state_hash = run_master(2, "parallel", 2, lambda k: (k + 1) * STEP_NS / 1e9 - k * STEP_NS / 1e9)
    np.testing.assert_array_equal(np.array(rows), expected)
    assert values.last_string_values(bed, [references["state_hash"]]) == [state_hash.encode()]
    assert execution.status().state != CosimExecutionState.ERROR.value


@pytest.mark.parametrize("version", [2, 3])
def test_a_master_with_rollback_matches_redo(
    machine_units: dict[int, Path], spring: Path, machine_case: ballast.Case, beds: Path, run_master: Callable[..., Outcome],
    version: int, tmp_path: Path,
) -> None:  # fmt: skip
    """CoFmuPy repeats each step from a saved state until mass and ballast agree, ten times at most."""
    pytest.importorskip("fmu_manipulation_toolbox")
    cofmupy = ROOT / "target/cofmupy"
    if not cofmupy.exists():
        pytest.skip("target/cofmupy is missing; scripts/test_python.sh installs it")
    # CoFmuPy sets all inputs and reads all outputs as real numbers.
    part = tmp_path / "part.fmu"
    names = "|".join(map(re.escape, (POSITION, VELOCITY, FORCE, "state_hash", "time")))
    tool("fmutool", "-input", machine_units[version], "-keep-only-regexp", f"^({names})$", "-output", part)
    program = [sys.executable, Path(__file__).with_name("cofmupy_process.py"), part, spring, TINE, STEP, STEPS]
    done = subprocess.run([*map(str, program)], capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(cofmupy)})
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert 2 < max(found["counts"]) < 10, "no step was repeated, or one has not converged"
    assert found["hash"] != run_master(version, "sequential", 1)[1]
    with ballast.open(machine_case, bed_cache=beds, threads=1, progress=False) as sim, Instance(spring) as mass:
        for k, (position, velocity) in enumerate(zip(found["position"], found["velocity"], strict=True)):
            state = sim.save()
            sim.advance_to(sim.now_ns + STEP_NS, motions(state, position + 1e-5, velocity))
            force = float(sim.redo(motions(state, position, velocity))[TINE].mean_force[2])
            assert force == found["force"][k]
            mass.set({"force": force})
            mass.fmu.doStep(k * STEP, STEP)
            assert mass.get("position") == pytest.approx(position, abs=1e-9)
        assert sim.save().hash == found["hash"]

"""The tamping unit of examples/machine and a co-simulation unit, compared with the loop without FMI."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import ballast
import numpy as np
import pytest
from ballast import couple
from conftest import ROOT

for module in ("fmpy", "scipy", "matplotlib"):
    pytest.importorskip(module)
FOLDER = ROOT / "examples/machine"
sys.path.insert(0, str(FOLDER))
import tamp  # noqa: E402
import tamp_fmu  # noqa: E402

#: A cycle that is short enough for a test: the pair stops by time.
SETTINGS = {"lift_time": 0.004, "insertion_time": 0.03, "insertion_limit": 0.035, "squeeze_time": 0.012}
OPTIONS = ["--threads", "1", "--tolerance", "1e-8", *(text for item in SETTINGS.items() for text in ("--set", "%s=%s" % item))]
STEPS = 104


def figures(sim: Any, window: int) -> dict[str, Any]:
    """Returns the figures of a run of `STEPS` time steps."""
    args = tamp.arguments([*OPTIONS, "--window", str(window), "--windows", str(STEPS // window)])
    coupling, unit = tamp.couple_unit(sim, sim.case, args)
    run = tamp.new_run(sim, args)
    for _ in tamp.cycle_windows(coupling, unit, run, args):
        pass
    found: dict[str, Any] = tamp.summary(run, unit, sim)
    assert found["iterations"]["max"] > 2 and found["received"] > 10.0 and found["squeezes"]
    return {name: value for name, value in found.items() if name != "wall"}


class MeanForces(couple.Coupling):
    """Coupling whose partner feels the mean forces of the window, as from the outputs of a co-simulation unit."""

    def _forces(self, result: ballast.WindowResult) -> dict[str, Any]:
        means = {name: np.concatenate([body.mean_force, body.mean_torque]) for name, body in result.items()}
        return {name: np.tile(mean, (self.window_steps, 1)) for name, mean in means.items()}


@pytest.mark.parametrize(("version", "window"), [(2, 1), (3, 2)])
def test_the_loop_through_a_unit_gives_the_figures_of_the_direct_loop(
    machine_units: dict[int, Path], machine_case: ballast.Case, beds: Path, monkeypatch: pytest.MonkeyPatch,
    version: int, window: int,
) -> None:  # fmt: skip
    """Closings, forces, energies, iterations and the state agree to the last bit."""
    with tamp_fmu.UnitSimulation(machine_units[version], 1) as sim:
        found = figures(sim, window)
    if window > 1:
        monkeypatch.setattr(couple, "Coupling", MeanForces)
    with ballast.open(machine_case, bed_cache=beds, threads=1, progress=False) as sim:
        assert found == figures(sim, window)


def test_a_refused_window_leaves_the_unit_as_it_was(machine_units: dict[int, Path]) -> None:
    with tamp_fmu.UnitSimulation(machine_units[2], 1) as sim:
        state = sim.save()
        x, q = state.commanded_pose("sleeper_1")
        zero, times = np.zeros((2, 3)), [0, sim.step_ns]
        far = ballast.Motion(times, [x, x + [0, 0, 100.0]], [q, q], velocities=zero, angular_velocities=zero)
        result = sim.advance_to(sim.step_ns, {"sleeper_1": far})
        assert result.status == "discard" and result.error_message
        assert sim.now_ns == 0 and sim.save().hash == state.hash
        assert list(sim.save().commanded_pose("sleeper_1")[0]) == list(x)


def test_the_program_tamps_a_unit(machine_units: dict[int, Path], tmp_path: Path) -> None:
    program = [sys.executable, FOLDER / "tamp_fmu.py", machine_units[2], "--out", tmp_path, "--windows", "5", "--threads", "1"]
    done = subprocess.run([*map(str, program)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert json.loads((tmp_path / "figures.json").read_text())["windows"] == 5
    assert "work of the drives" in (tmp_path / "table.md").read_text()
    for options, message in ((["--seed", "3"], "--seed: expected none"), ([], "expected a co-simulation unit")):
        refused = [sys.executable, FOLDER / "tamp_fmu.py", *([machine_units[2]] if options else []), *options]
        done = subprocess.run([*map(str, refused)], capture_output=True, text=True)
        assert done.returncode == 1 and message in done.stderr

"""Shared fixtures: a small case and its prepared bed."""

from __future__ import annotations

import functools
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

# Small matrices of the examples: threads would only wait for each other.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import ballast  # noqa: E402
import pytest  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]

# Where a shell has started the tests in its background, Ctrl-C is ignored from the start.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def case() -> ballast.Case:
    return ballast.Case.load(ROOT / "interfaces/cli/tests/data/tiny.toml")


@pytest.fixture(scope="session")
def beds(case: ballast.Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("beds")
    ballast.prepare(case, bed_cache=folder, threads=1, progress=False)
    return folder


@pytest.fixture(scope="session")
def machine_case(case: ballast.Case) -> ballast.Case:
    """The small case with rigid tines and compliant contacts, fit for a partner with mass."""
    return case.with_values({
        "tines.mount": {"rigid": True}, "bed.stiffness": {"grain_N_per_m": 1e6},
        "tamping.insertion.duration_s": 0.1, "run.duration_s": 0.4, "run.step_s": 5e-4,
        "solver.max_iterations": 1000, "solver.tolerance": 1e-4,
    })  # fmt: skip


@pytest.fixture(scope="session")
def units(case: ballast.Case, beds: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Co-simulation units of the small case by version of FMI."""
    return export_units(case, beds, tmp_path_factory.mktemp("units"))


@pytest.fixture(scope="session")
def machine_units(machine_case: ballast.Case, beds: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Co-simulation units of the case for partners with mass, by version of FMI."""
    return export_units(machine_case, beds, tmp_path_factory.mktemp("machine_units"))


@pytest.fixture
def sim(case: ballast.Case, beds: Path) -> Iterator[ballast.Simulation]:
    with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
        yield sim


def export_units(case: ballast.Case, beds: Path, folder: Path) -> dict[int, Path]:
    """Exports co-simulation units of a case and returns their paths by version of FMI."""
    case.write(folder / "tiny.toml")
    program = [ROOT / "target/release/ballast", "export", "fmu", "tiny.toml", "--out", "tiny.fmu", "--fmi", "both"]
    done = subprocess.run([*program, "--bed-cache", beds], capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    return {version: folder / f"tiny_fmi{version}.fmu" for version in (2, 3)}


def renamed(case: ballast.Case, stroke_m: float = 0.02) -> ballast.Case:
    """Returns the small case with a sleeper and tines of other names."""
    values = case.to_dict()
    [block], rows = values.pop("sleepers")["blocks"], values.pop("tines")
    (x, y, _), half = values["bed"]["size_m"], 0.5 * (block["size_m"][0] + rows["blade_size_m"][0])
    values["sleeper"] = [{"name": "block", "blocks": [block], "x_m": 0.5 * x, "y_m": 0.5 * y, "tamped": True}]
    values["tine"] = [
        {"name": name, "pair": 0, "squeeze_direction": direction, "y_m": 0.5 * y,
         "x_m": 0.5 * x + side * (half + rows["gap_to_sleeper_m"]),
         "blade_size_m": rows["blade_size_m"], "shaft_size_m": rows["shaft_size_m"]}
        for name, direction, side in (("left", "+x", -1.0), ("right", "-x", 1.0))
    ]  # fmt: skip
    values["tamping"]["squeeze"]["stroke_m"] = stroke_m
    return ballast.Case.from_dict(values)


@functools.cache
def drawing_fault() -> str | None:
    """Returns why nothing can be drawn here, if so: drawing needs a graphics library, without which the process may die."""
    ball = "import pyvista as pv; p = pv.Plotter(off_screen=True); p.add_mesh(pv.Sphere()); p.screenshot()"
    done = subprocess.run([sys.executable, "-c", ball], capture_output=True, text=True)
    return None if done.returncode == 0 else done.stderr.strip()[-200:]


def lowered(sim: ballast.Simulation, depth: float, steps: int) -> dict[str, ballast.Motion]:
    """Returns motions that lower all tines by `depth` (m) at constant speed in the next steps."""
    now = sim.now_ns
    times = [now, now + steps * sim.step_ns]
    motions = {}
    for tine in sim.tines:
        x, q = sim.save().commanded_pose(tine.name)
        motions[tine.name] = ballast.Motion(times, [x, x - [0.0, 0.0, depth]], [q, q])
    return motions

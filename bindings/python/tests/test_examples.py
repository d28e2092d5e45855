"""Runs every example and scripts/check_states.py on a small case."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import ballast
import pytest
from conftest import ROOT, drawing_fault, renamed

EXAMPLES = ROOT / "examples/python"


@pytest.fixture
def place(case: ballast.Case, beds: Path, tmp_path: Path) -> Path:
    """Working folder with the small case and its prepared bed."""
    case.write(tmp_path / "tiny.toml")
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs/beds").symlink_to(beds)
    return tmp_path


def run(place: Path, name: str | Path, *arguments: str) -> str:
    program = [sys.executable, EXAMPLES / name, "tiny.toml", *arguments]
    done = subprocess.run(program, capture_output=True, text=True, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_coupling(place: Path) -> None:
    lines = run(place, "coupling.py").splitlines()
    assert len(lines) > 5 and all(" N" in line for line in lines)


def test_squeeze_until_force(place: Path) -> None:
    last = run(place, "squeeze_until_force.py", "3").splitlines()[-1]
    assert last == "reached 3 N"


def test_implicit_coupling(place: Path) -> None:
    assert "mean passes per window" in run(place, "implicit_coupling.py")


@pytest.mark.parametrize("name", ["coupling.py", "implicit_coupling.py", "squeeze_until_force.py"])
@pytest.mark.parametrize("missing", ["tines", "tamping"])
def test_examples_refuse_cases_without_tamping(case: ballast.Case, place: Path, name: str, missing: str) -> None:
    values = case.to_dict()
    del values[missing]
    ballast.Case.from_dict(values).write(place / "tiny.toml")
    assert refused(place, name) == ["tiny: expected tines and [tamping], found none"]


def test_examples_end_when_a_step_fails(place: Path) -> None:
    (place / "stuck.py").write_text(STUCK)
    said = refused(place, place / "stuck.py", str(EXAMPLES / "squeeze_until_force.py"))
    assert said == ["0.0010 s  discard  over_speed: a stone is too fast"]


#: Runs an example whose tamping cycle fails.
STUCK = """
import runpy, sys, types, ballast

class Stuck:
    def __init__(self, sim):
        self.sim = sim

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.sim.close()

    def __getattr__(self, name):
        return getattr(self.sim, name)

    def step_tamping_cycle(self):
        return types.SimpleNamespace(status="discard", code="over_speed", error_message="a stone is too fast", t1_ns=1000000)

begin = ballast.open
ballast.open = lambda case: Stuck(begin(case))
runpy.run_path(sys.argv.pop(1), run_name="__main__")
"""


def refused(place: Path, name: str | Path, *arguments: str) -> list[str]:
    """Returns the lines on stderr of an example that must fail without output."""
    program = [sys.executable, EXAMPLES / name, *arguments, "tiny.toml"]
    done = subprocess.run(program, capture_output=True, text=True, cwd=place, timeout=120)
    assert done.returncode == 1 and not done.stdout, done.stdout
    return done.stderr.splitlines()


def test_record_and_replay(place: Path) -> None:
    assert "40 windows" in run(place, "record_and_replay.py")


def test_frequency_study(place: Path) -> None:
    for needed in ("pandas", "matplotlib"):
        pytest.importorskip(needed)
    run(place, "frequency_study.py", "study", "30,60", "7")
    assert (place / "study/frequency.png").stat().st_size > 5000
    assert (place / "study/table.csv").read_text().count("\n") == 3


def test_window_study(place: Path) -> None:
    for needed in ("scipy", "matplotlib"):
        pytest.importorskip(needed)
    said = run(place, "window_study.py", "study", "4,2", "7,8")
    assert said.count("100 %") == 7
    assert (place / "study/windows.png").stat().st_size > 5000
    rows = (place / "study/table.md").read_text().splitlines()
    assert rows[0].count("|") == rows[2].count("|") == 10
    # The beds are two, so they scatter.
    assert any(float(row.split("|")[-4]) > 0.0 for row in rows[2:])


def test_window_study_replays_all_moving_bodies(case: ballast.Case, place: Path) -> None:
    for needed in ("scipy", "matplotlib"):
        pytest.importorskip(needed)
    # What the folder holds of the case of before is none of it.
    run(place, "window_study.py", "study", "2,1", "7")
    renamed(case).write(place / "tiny.toml")
    said = run(place, "window_study.py", "study", "2,1", "7")
    assert "larger than the range" not in said and "smallest p" not in said, "one bed has no range"
    assert said.count("100 %") == 4
    motions = [json.loads(path.read_text()) for path in (place / "study").glob("*/motion_7.json")]
    assert len(motions) == 2
    [reported] = [motion for motion in motions if "block" in motion]
    assert set(reported) == {"times_ns", "phases", "left", "right", "block"}
    lifted = [height for _, _, height, *_ in reported["block"]]
    assert max(lifted) - lifted[0] == pytest.approx(case.to_dict()["tamping"]["lift"]["height_m"])
    # Figures that are nothing in every phase have no row.
    assert "| vertical impulse of the sleepers, N s |" in said


def test_check_states_script(place: Path) -> None:
    said = run(place, ROOT / "scripts/check_states.py", "--steps", "5")
    assert said.count("  the same: ") == 5


def test_tour_notebook(place: Path) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    pytest.importorskip("matplotlib")
    notebook = nbformat.read(EXAMPLES / "tour.ipynb", as_version=4)
    os.environ["BALLAST_CASE"] = str(place / "tiny.toml")
    try:
        client = nbclient.NotebookClient(notebook, resources={"metadata": {"path": str(place)}})
        client.execute()
    finally:
        del os.environ["BALLAST_CASE"]
    outputs = [out for cell in notebook.cells for out in cell.get("outputs", [])]
    assert not any(out["output_type"] == "error" for out in outputs)
    assert any("image/png" in out.get("data", {}) for out in outputs)


#: Packages that each notebook needs besides matplotlib.
NOTEBOOKS = {
    "first_bed": [],
    "coupled_controller": [],
    "study": ["pandas", "loky"],
    "results": ["pandas", "xarray", "pyvista", "trame_vtk"],
}


@pytest.mark.parametrize("name", NOTEBOOKS)
def test_notebooks(place: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    for package in ("ipykernel", "matplotlib", *NOTEBOOKS[name]):
        pytest.importorskip(package)
    notebook = nbformat.read(ROOT / f"examples/notebooks/{name}.ipynb", as_version=4)
    nbformat.validate(notebook)
    assert "\nTime on two cores: " in notebook.cells[0].source
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert all(not cell.outputs and cell.execution_count is None for cell in code), "the notebook has outputs"
    if name == "results":
        program = ROOT / "target/release/ballast"
        if not program.exists() or drawing_fault():
            pytest.skip(drawing_fault() or f"{program} is not built")
        monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)
    # As Jupyter runs it: from the folder of the notebook.
    (place / "examples/notebooks").mkdir(parents=True)
    (place / "tiny.toml").rename(place / "examples/first.toml")
    folder = {"metadata": {"path": str(place / "examples/notebooks")}}
    nbclient.NotebookClient(notebook, timeout=300, resources=folder).execute()
    assert any("image/png" in out.get("data", {}) for cell in code for out in cell.outputs)
    assert list((place / "examples/notebooks").iterdir()) == []


def test_all_notebooks_are_tested_and_listed() -> None:
    found = {path.stem for path in (ROOT / "examples/notebooks").glob("*.ipynb")}
    guide = (ROOT / "docs/src/guide/python.md").read_text()
    assert found == set(NOTEBOOKS) and all(f"examples/notebooks/{name}.ipynb" in guide for name in found)


PAGES = [
    ROOT / page
    for page in (
        "README.md",
        "docs/src/getting-started/first-python-script.md",
        "docs/src/guide/python.md",
        "docs/src/guide/sweeps.md",
    )
]


def blocks() -> list[Any]:
    """Returns the Python code blocks of README and guide."""
    found = [
        pytest.param(code, id=f"{page.name}-{i}")
        for page in PAGES
        for i, code in enumerate(re.findall(r"^```python\n(.*?)^```$", page.read_text(), re.M | re.S))
    ]
    assert len(found) > 3
    return found


@pytest.mark.parametrize("code", blocks())
def test_code_blocks_of_the_documents(place: Path, code: str) -> None:
    if "zenoh:" in code:
        pytest.skip("needs another process; test_remote does the like")
    for word, needed in (("study", "pandas"), ("view.live", "rerun"), ("tables", "xarray"), ("frames", "pyvista"), ("save_page", "trame_vtk")):
        if word in code:
            pytest.importorskip(needed)
    (place / "examples").mkdir()
    (place / "tiny.toml").rename(place / "examples/first.toml")
    if "runs/look" in code:
        program = ROOT / "target/release/ballast"
        if not program.exists():
            pytest.skip(f"{program} is not built")
        called = [program, "run", "examples/first.toml", "--steps", "30", "--out", "runs/look"]
        subprocess.run(called, check=True, capture_output=True, cwd=place)
    if "runs/slice_beds" in code:
        (place / "runs/slice_beds").mkdir(parents=True)
        table = "number,bed.seed,compactness.under/sleeper_1.after\n1,1,0.60\n2,2,0.59\n"
        (place / "runs/slice_beds/table.csv").write_text(table)
    # As it is shown: processes that a study begins import this file. Imports are said once in a page.
    (place / "shown.py").write_text(f"import ballast\n{code}")
    done = subprocess.run([sys.executable, "shown.py"], capture_output=True, text=True, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr


def test_all_examples_are_tested() -> None:
    # The partner over the network is run by the tests of the program.
    text = Path(__file__).read_text() + (ROOT / "interfaces/cli/tests/program/serve.rs").read_text()
    assert all(p.name in text for p in EXAMPLES.iterdir() if p.suffix in (".py", ".ipynb"))

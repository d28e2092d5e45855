"""Imports, docstrings and types of the package."""

from __future__ import annotations

import ast
import inspect
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import ballast
import pytest
from conftest import ROOT


def test_import_needs_only_numpy() -> None:
    program = (
        "import sys, numpy; before = set(sys.modules); import ballast\n"
        "print(sorted({m.split('.')[0] for m in set(sys.modules) - before} - set(sys.stdlib_module_names)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "['ballast']"


def test_exported_names_exist() -> None:
    assert all(hasattr(ballast, name) for name in ballast.__all__)
    assert repr(ballast.Motion([0], [[0, 0, 0]])) == "Motion(1 knots, 0 to 0 ns, linear)"
    assert issubclass(ballast.InternalError, ballast.Error)


def test_docstrings_equal_the_stub() -> None:
    """`test_types` checks that the stub has the same members."""
    stubs = ast.parse((Path(ballast.__file__).parent / "_ballast.pyi").read_text())
    silent, other, seen = [], [], 0
    for stub in (node for node in stubs.body if isinstance(node, ast.ClassDef)):
        there = getattr(ballast, stub.name)
        members = [m for m in stub.body if isinstance(m, ast.FunctionDef) and not m.name.startswith("_")]
        for name, text, runtime in [
            (stub.name, ast.get_docstring(stub), there),
            *((f"{stub.name}.{m.name}", ast.get_docstring(m), getattr(there, m.name)) for m in members),
        ]:
            seen += 1
            if not text or not inspect.getdoc(runtime):
                silent.append(name)
            # Attributes of exceptions have no docstring at runtime; that of the class describes them.
            elif text != inspect.getdoc(runtime) and not issubclass(there, Exception):
                other.append(name)
    assert seen > 150 and (silent, other) == ([], [])
    functions = (getattr(ballast, name) for name in ballast.__all__ if name != "__version__")
    assert all(inspect.getdoc(function) for function in functions)


@pytest.mark.parametrize(
    ("case", "options"),
    [
        ("case.toml", {"connect": ()}),
        ("case.toml", {"listen": 0}),
        ("case.toml", {"config": ""}),
        ("zenoh:test/bed", {"seed": 0}),
        ("zenoh:test/bed", {"schedule": ""}),
        ("zenoh:test/bed", {"threads": 0}),
        ("zenoh:test/bed", {"max_penetration": 0.0}),
        ("zenoh:test/bed", {"keep_partial_window": True}),
        ("zenoh:test/bed", {"connect": ""}),
        ("zenoh:test/bed", {"listen": 0}),
        ("zenoh:test/bed", {"bed_cache": "elsewhere"}),
        ("zenoh:test/bed", {"config": 0}),
    ],
)
def test_options_without_effect_raise(case: str, options: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=next(iter(options))):
        ballast.open(case, **options)


def test_missing_zenoh_configuration_raises() -> None:
    with pytest.raises(ballast.RemoteError) as unreachable:
        ballast.open("zenoh:test/bed", config="")
    assert unreachable.value.code == "transport"


SETTINGS = str(ROOT / "bindings/python/pyproject.toml")


@pytest.fixture(scope="session")
def mypy(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., None]:
    """Runs a tool of mypy with a shared cache."""
    pytest.importorskip("mypy")
    found = os.environ | {"MYPY_CACHE_DIR": str(tmp_path_factory.mktemp("mypy"))}

    def run(cwd: Path, tool: str, *options: str) -> None:
        called = [sys.executable, "-m", tool, *options]
        done = subprocess.run(called, capture_output=True, text=True, cwd=cwd, env=found)
        assert done.returncode == 0, done.stdout + done.stderr

    return run


@pytest.mark.parametrize(
    "check",
    [
        ["mypy", "--config-file", SETTINGS, "-p", "ballast"],
        ["mypy.stubtest", "--mypy-config-file", SETTINGS, "ballast._ballast", "--ignore-disjoint-bases"],
    ],
    ids=["strict", "stubs"],
)
def test_types(check: list[str], mypy: Callable[..., None], tmp_path: Path) -> None:
    mypy(tmp_path, *check)


USES = """
from collections.abc import Mapping

import ballast
import numpy as np
import numpy.typing as npt
from ballast import study

def use(sim: ballast.Simulation, case: ballast.Case, seeds: npt.NDArray[np.int64]) -> ballast.WindowResult:
    times = np.linspace(sim.now_ns, sim.now_ns + 5 * sim.step_ns, 3).astype(int)
    rows = np.zeros((3, 3))
    ballast.Load([0, np.int32(5), np.uint64(7)], rows)
    ballast.Motion(range(3), rows)
    for seed in seeds:
        case = case.choose(seed=seed)
    out: Mapping[str, ballast.BodyResult] = dict(sim.advance_to(times[0]))
    assert list(out) == sim.bodies
    return sim.advance_to(times[-1], {"tine_1": ballast.Motion(times, rows)}, {"sleeper_1": ballast.Load(times, rows)})

def whole(case: ballast.Case, beds: str) -> dict[str, int]:
    return {"seed": case.seed}

def some(case: ballast.Case, beds: str) -> dict[str, float | None]:
    return {"seed": None}

MEASURES: list[study.Measure] = [whole, some, study.run_tamping_cycle]
"""


def test_types_accept_common_usage(mypy: Callable[..., None], tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    (tmp_path / "uses.py").write_text(USES)
    # Without the package's own settings, as a user checks.
    mypy(tmp_path, "mypy", "--strict", "-m", "uses", "-m", "ballast.view")

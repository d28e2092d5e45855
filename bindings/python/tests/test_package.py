"""The package as such: what it imports, whether its stubs are true."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import ballast
import pytest
from conftest import ROOT


def test_only_numpy_comes_with_it() -> None:
    program = (
        "import sys, numpy; before = set(sys.modules); import ballast\n"
        "print(sorted({m.split('.')[0] for m in set(sys.modules) - before} - set(sys.stdlib_module_names)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "['ballast']"


def test_names_are_those_of_the_package() -> None:
    assert all(hasattr(ballast, name) for name in ballast.__all__)
    assert repr(ballast.Motion([0], [[0, 0, 0]])) == "Motion(1 knots, 0 to 0 ns, linear)"
    assert issubclass(ballast.Lost, ballast.Error)


SETTINGS = str(ROOT / "bindings/python/pyproject.toml")


@pytest.mark.parametrize(
    "check",
    [
        ["mypy", "--config-file", SETTINGS, "-p", "ballast"],
        ["mypy.stubtest", "--mypy-config-file", SETTINGS, "ballast._ballast", "--ignore-disjoint-bases"],
    ],
    ids=["strict", "stubs"],
)
def test_types(check: list[str], tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    done = subprocess.run(
        [sys.executable, "-m", *check], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 0, done.stdout + done.stderr

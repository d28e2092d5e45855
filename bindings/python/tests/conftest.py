"""What the tests share: a small case, its bed prepared once."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from pathlib import Path

import ballast
import pytest

ROOT = Path(__file__).resolve().parents[3]

# Where a shell has started the tests in its background, Ctrl-C is ignored from the start.
signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def case() -> ballast.Case:
    return ballast.Case.load(ROOT / "interfaces/cli/tests/data/tiny.toml")


@pytest.fixture(scope="session")
def beds(case: ballast.Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("beds")
    ballast.prepare(case, beds=folder, threads=1, progress=False)
    return folder


@pytest.fixture
def sim(case: ballast.Case, beds: Path) -> Iterator[ballast.Simulation]:
    with ballast.open(case, beds=beds, threads=1, progress=False) as sim:
        yield sim


def lowered(sim: ballast.Simulation, depth: float, steps: int) -> dict[str, ballast.Motion]:
    """All tines go down by `depth` (m) at constant speed within the next steps."""
    now = sim.now_ns
    times = [now, now + steps * sim.step_ns]
    motions = {}
    for tine in sim.tines:
        x, q = sim.save().target(tine.name)
        motions[tine.name] = ballast.Motion(times, [x, x - [0.0, 0.0, depth]], [q, q])
    return motions

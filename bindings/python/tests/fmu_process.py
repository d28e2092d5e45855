"""Advances a unit with FMPy: python fmu_process.py UNIT FROM TO [STATE]; prints the hash of its state."""

from __future__ import annotations

import sys
from pathlib import Path

from fmu_instance import Instance

STEP = 0.004


def advance(unit: Path, first: int, last: int, state: bytes | None = None) -> tuple[str, bytes]:
    """Lowers the first tine in the steps `first` to `last`; returns the hash of the state, and the state."""
    with Instance(unit, state=state) as instance:
        tine = next(name.split(".")[0] for name in instance.variables if name.startswith("tine"))
        height = f"{tine}.position[3]"
        # The height at the start of the run is in the description.
        start = instance.start(height)
        for step in range(first, last):
            instance.set({height: start - 0.2 * STEP * (step + 1), f"{tine}.velocity[3]": -0.2})
            instance.fmu.doStep(step * STEP, STEP)
        assert instance.get(height) == start - 0.2 * STEP * last
        return instance.get("state_hash"), instance.state()


if __name__ == "__main__":
    unit, first, last, *state = sys.argv[1:]
    given = Path(state[0]).read_bytes() if state else None
    print(advance(Path(unit), int(first), int(last), given)[0])

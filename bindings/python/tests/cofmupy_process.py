"""Couples a unit and a mass on a spring with CoFmuPy: python cofmupy_process.py UNIT SPRING TINE STEP STEPS.

Prints positions, velocities and forces after each step, the number of computations of each step, and the hash of the last
state, as JSON. Runs with an older FMPy than the other tests, which CoFmuPy needs.
"""

from __future__ import annotations

import importlib.util
import json
import sys

# The package itself imports servers and plots; the master needs none of them.
spec = importlib.util.find_spec("cofmupy")
assert spec is not None
sys.modules["cofmupy"] = importlib.util.module_from_spec(spec)

from cofmupy.master import DefaultMaster  # noqa: E402


def main() -> None:
    unit, spring, tine, step, steps = sys.argv[1:]
    position, velocity, force = (f"{tine}.{quantity}[3]" for quantity in ("position", "velocity", "force"))
    links = {
        ("spring", "position"): [("bed", position)],
        ("spring", "velocity"): [("bed", velocity)],
        ("bed", force): [("spring", "force")],
    }
    master = DefaultMaster(
        [{"id": "spring", "path": spring, "initialization": {}}, {"id": "bed", "path": unit, "initialization": {}}],
        links, [["spring", "bed"]], cosim_method="gauss_seidel", iterative=True,
    )  # fmt: skip
    bed = master.fmu_handlers["bed"]
    # Otherwise the master would start all inputs at 0.
    [height] = bed.get_variable(position)
    master.fmu_config_list[1]["initialization"] = {position: height}
    master.init_simulation()
    calls, advance = [], bed.step
    bed.step = lambda *values: calls.append(0) or advance(*values)
    counts = []
    for _ in range(int(steps)):
        before = len(calls)
        master.do_step(float(step))
        counts.append(len(calls) - before)
    results = master.get_results()
    found = {"position": results["spring", "position"], "velocity": results["spring", "velocity"], "force": results["bed", force]}
    [text] = bed.get_variable("state_hash")
    print(json.dumps(found | {"counts": counts, "hash": text.decode() if isinstance(text, bytes) else text}))


if __name__ == "__main__":
    main()

"""Checks that a run continues bit for bit from every kind of saved state.

    python scripts/check_states.py CASE [--steps 6] [--bed-cache runs/beds]

The case's tamping cycle moves the bodies, one step per window. The first steps are run

* without interruption, on one thread;
* with the state saved half way, the run finished, the state restored and the run finished again;
* with the state of half way written to a file and the run finished by another process, on two threads;
* with every window redone three times;
* by a fork, made half way.

Needs the package of bindings/python.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import ballast


def finish(sim: ballast.Simulation, steps: int) -> str:
    """Returns the hash after `steps` windows of one step."""
    for _ in range(steps):
        sim.step_tamping_cycle()
    return sim.save().hash


def redone(sim: ballast.Simulation, steps: int) -> str:
    for _ in range(steps):
        before = sim.save()
        sim.step_tamping_cycle()
        after = sim.save()
        # The motions of the tamping cycle. Bodies that it did not move have a commanded twist of zero instead of None.
        motions = {name: between(before, after, name) for name in sim.bodies if after.commanded_twist(name) is None}
        for _ in range(3):
            sim.redo(motions)
    return sim.save().hash


def between(before: ballast.State, after: ballast.State, name: str) -> ballast.Motion:
    ends = [state.commanded_pose(name) for state in (before, after)]
    times = [before.time_ns, after.time_ns]
    return ballast.Motion(times, [end[0] for end in ends], [end[1] for end in ends])


def in_another_process(case: str, state: Path, steps: int) -> str:
    command = [sys.executable, __file__, case, "--steps", str(steps), "--resume", str(state)]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def compare(args: argparse.Namespace) -> bool:
    half = args.steps // 2
    rest = args.steps - half
    with ballast.open(args.case, bed_cache=args.bed_cache, threads=1) as sim:
        start = sim.save()
        expected = finish(sim, args.steps)
        print(f"{args.case}: {args.steps} steps of {sim.grain_count} grains: {expected}")

        sim.restore(start)
        finish(sim, half)
        kept = sim.save()
        ends = {"saved half way": finish(sim, rest)}
        sim.restore(kept)
        ends["restored"] = finish(sim, rest)

        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "half.h5"
            kept.write(file)
            ends["restored in another process, on two threads"] = in_another_process(args.case, file, rest)

        sim.restore(kept)
        with sim.fork() as fork:
            ends["forked"] = finish(fork, rest)

        sim.restore(start)
        ends["every window redone three times"] = redone(sim, args.steps)
    for way, end in ends.items():
        print(f"  {'the same' if end == expected else 'OTHER: ' + end}: {way}")
    return all(end == expected for end in ends.values())


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("case")
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--bed-cache", default="runs/beds")
    parser.add_argument("--resume", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.resume:
        with ballast.resume(args.resume, threads=2) as sim:
            print(finish(sim, args.steps))
        return 0
    return 0 if compare(args) else 1


if __name__ == "__main__":
    sys.exit(main())

"""Where more threads stop to help: a model of a step of 100 sweeps, fed with what `ballast bench` measured.

    python3 scripts/scaling_model.py [--bandwidth 200] [--results benches/results]

docs/performance.md says what is in it and what is not. Prints the table as Markdown.
"""

import argparse
import csv
import math
from pathlib import Path
from typing import NamedTuple

# Of step_seven_sleepers.csv.
SWEEPS = 100
# Interface contacts over contacts are INTERFACE / (contacts of a subdomain)^(1/3): 9.6 % at 12 000 (seven_sleepers),
# 14.1 % at 4100 (laptop, subdomains_laptop.csv).
INTERFACE = 2.2
# Waiting at a barrier of two threads, s: an iteration of laptop on two slabs has two barriers and takes 43 us less
# without them (asynchronous 83 ms, synchronous 96 ms, 300 iterations). It grows with the logarithm of the threads.
BARRIER = 43e-6 / 2
# Colours of the interface, each with a barrier: a compact subdomain has about 14 neighbours.
COLOURS = 14
# Sweeps per visit of a subdomain that fits a cache, and contacts of the largest that does.
PER_VISIT, LARGEST = 2, 12000
# Subdomains for each thread that keep them evenly busy.
PER_THREAD = 4


def table(path: Path) -> tuple[dict[str, str], list[dict[str, str]]]:
    lines = path.read_text().splitlines()
    notes = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# ") and ": " in line)
    return notes, list(csv.DictReader(line for line in lines if not line.startswith("#")))


class Row(NamedTuple):
    """A step of a bed of so many grains on so many threads; times in s, shares of 1."""

    grains: int
    threads: int
    subdomain: float
    interface: float
    bound: str
    solve: float
    whole: float
    efficiency: float


def model(results: Path, bandwidth: float) -> tuple[list[Row], float, float]:
    """The rows, and of the step that was measured on one thread how much does not divide, and the whole, s."""
    notes, rows = table(results / "step_seven_sleepers.csv")
    # "seven_sleepers, 86166 grains, from step 0 of 8820"
    measured = int(notes["scene"].split(", ")[1].split()[0])
    contacts, visits = float(notes["contacts"].split()[0]), float(notes["visits of a step"])
    one = {row["phase"]: row for row in rows if row["threads"] == "1"}
    two = {row["phase"]: row for row in rows if row["threads"] == "2"}
    # Where a phase is not twice as fast on two threads, part of it is taken for serial; only the small phases, of which
    # it is known.
    small = ["predict", "warm start", "partition", "integrate", "store"]
    wall = {phase: 1e-3 * float(row["wall_mean_ms"]) for phase, row in one.items()}
    serial = sum(wall[p] * max(0.0, 2.0 / float(two[p]["speedup"]) - 1.0) for p in small)
    parallel = wall["whole step"] - wall["solve"] - serial

    _, rows = table(results / "kernel_epyc.csv")
    best = [row for row in rows if row["threads"] == "1" and row["form"] == "one set per thread"]
    rate = 1e6 * max(float(row["mvisits_per_s"]) for row in best)
    largest = max(best, key=lambda row: int(row["contacts"]))
    streamed, per_core = float(largest["bytes_per_visit"]), float(largest["triad_gb_per_s"])

    modelled = []
    for grains in (measured, 1_000_000, 10_000_000):
        scale = grains / measured
        alone = 0.0
        for threads in (1, 2, 16, 64, 256):
            size = min(LARGEST, scale * contacts / (PER_THREAD * threads))
            arithmetic = scale * visits / (rate * threads)
            memory = scale * visits * streamed / PER_VISIT / (1e9 * min(bandwidth, per_core * threads))
            waiting = SWEEPS / PER_VISIT * (1 + COLOURS) * BARRIER * math.log2(threads)
            solve = max(arithmetic, memory) + waiting
            whole = solve + scale * (parallel / threads + serial)
            alone = alone or whole
            bound = "barriers" if waiting > max(arithmetic, memory) else "memory" if memory > arithmetic else "arithmetic"
            interface = INTERFACE / size ** (1 / 3)
            modelled.append(Row(grains, threads, size, interface, bound, solve, whole, alone / whole / threads))
    return modelled, serial, wall["whole step"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--bandwidth", type=float, default=200.0, help="of the memory of the machine, GB/s")
    parser.add_argument("--results", type=Path, default=Path("benches/results"))
    args = parser.parse_args()
    rows, serial, whole = model(args.results, args.bandwidth)
    print(f"serial: {1e3 * serial:.0f} ms of {1e3 * whole:.0f} ms on one thread")
    print("| grains | threads | contacts of a subdomain | interface | visits bound by | solve, s | whole step, s | efficiency |")
    print("|---|---|---|---|---|---|---|---|")
    for r in rows:
        print(
            f"| {r.grains} | {r.threads} | {r.subdomain:.0f} | {100 * r.interface:.0f} % | {r.bound} "
            f"| {r.solve:.3g} | {r.whole:.3g} | {100 * r.efficiency:.0f} % |"
        )


if __name__ == "__main__":
    main()

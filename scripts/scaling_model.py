"""Where more threads stop to help: a model of a step of 100 sweeps, fed with what `ballast bench` measured.

    python3 scripts/scaling_model.py [--bandwidth 200] [--results benches/results]

docs/src/developer/performance.md says what is in it and what is not. Prints the table as Markdown.
"""

import argparse
import csv
from pathlib import Path
from typing import NamedTuple

# Of step_seven_sleepers.csv.
SWEEPS = 100
# Interface contacts over contacts are INTERFACE / (contacts of a subdomain)^(1/3): 9.6 % at 12 000 (seven_sleepers).
INTERFACE = 2.2
# Sweeps per visit of a subdomain that fits a cache, and contacts of the largest that does.
PER_VISIT, LARGEST = 2, 12000
# Subdomains for each thread that keep them evenly busy.
PER_THREAD = 4
THREADS = (1, 2, 4, 8, 16, 64, 256)


def table(path: Path) -> tuple[dict[str, str], list[dict[str, str]]]:
    lines = path.read_text().splitlines()
    notes = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# ") and ": " in line)
    return notes, list(csv.DictReader(line for line in lines if not line.startswith("#")))


class Row(NamedTuple):
    """Times (s) and fractions (1) of a step, for a number of grains and threads."""

    grains: int
    threads: int
    subdomain: float
    interface: float
    bound: str
    solve: float
    whole: float
    efficiency: float


def model(results: Path, bandwidth: float) -> tuple[list[Row], dict[str, float]]:
    """The rows, and what was measured: seconds of a step on one thread and on the most, and what of them does not divide."""
    notes, rows = table(results / "step_seven_sleepers.csv")
    # "seven_sleepers, 85982 grains, from step 0 of 8820"
    measured = int(notes["scene"].split(", ")[1].split()[0])
    contacts, visits = float(notes["contacts"].split()[0]), float(notes["visits of a step"])
    subdomains = float(notes["subdomains"])
    most = max(int(row["threads"]) for row in rows)
    one, many = ({row["phase"]: 1e-3 * float(row["wall_mean_ms"]) for row in rows if row["threads"] == n} for n in ("1", str(most)))
    # What most threads take beyond their share of what one takes is taken for serial, but for the solve.
    others = one["whole step"] - one["solve"]
    serial = max(0.0, (many["whole step"] - many["solve"] - others / most) / (1.0 - 1.0 / most))
    parallel = others - serial
    # Of the solve it is taken for waiting: in each iteration for some turns of a subdomain.
    rate = visits / one["solve"]
    turn = PER_VISIT * contacts / subdomains / rate
    waits = max(0.0, (many["solve"] - one["solve"] / most) / (SWEEPS / PER_VISIT * turn))

    _, rows = table(results / "kernel_sixteen.csv")
    sets = [row for row in rows if row["threads"] == "1" and row["form"] == "one set per thread" and row["instructions"] == "avx512"]
    largest = max(sets, key=lambda row: int(row["contacts"]))
    streamed, per_core = float(largest["bytes_per_visit"]), float(largest["triad_gb_per_s"])

    modelled = []
    for grains in (measured, 1_000_000, 10_000_000):
        scale = grains / measured
        alone = 0.0
        for threads in THREADS:
            size = min(LARGEST, scale * contacts / (PER_THREAD * threads))
            arithmetic = scale * visits / (rate * threads)
            memory = scale * visits * streamed / PER_VISIT / (1e9 * min(bandwidth, per_core * threads))
            waiting = SWEEPS / PER_VISIT * waits * PER_VISIT * size / rate if threads > 1 else 0.0
            solve = max(arithmetic, memory) + waiting
            whole = solve + scale * (parallel / threads + serial)
            alone = alone or whole
            bound = "waiting" if waiting > max(arithmetic, memory) else "memory" if memory > arithmetic else "arithmetic"
            interface = INTERFACE / size ** (1 / 3)
            modelled.append(Row(grains, threads, size, interface, bound, solve, whole, alone / whole / threads))
    found = {"one": one["whole step"], "most": many["whole step"], "threads": most, "serial": serial, "waits": waits, "rate": rate}
    return modelled, found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--bandwidth", type=float, default=200.0, help="of the memory of the machine, GB/s")
    parser.add_argument("--results", type=Path, default=Path("benches/results"))
    args = parser.parse_args()
    rows, found = model(args.results, args.bandwidth)
    print(
        f"measured: {1e3 * found['one']:.0f} ms on one thread, {1e3 * found['most']:.0f} ms on {found['threads']:.0f}, of which "
        f"{1e3 * found['serial']:.0f} ms do not divide; {found['waits']:.2f} turns of waiting per iteration; "
        f"{1e-6 * found['rate']:.0f} million visits per second and core"
    )
    print("| grains | threads | contacts of a subdomain | interface | visits bound by | solve, s | whole step, s | efficiency |")
    print("|---|---|---|---|---|---|---|---|")
    for r in rows:
        print(
            f"| {r.grains} | {r.threads} | {r.subdomain:.0f} | {100 * r.interface:.0f} % | {r.bound} "
            f"| {r.solve:.3g} | {r.whole:.3g} | {100 * r.efficiency:.0f} % |"
        )


if __name__ == "__main__":
    main()

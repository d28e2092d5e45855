"""Runs wheels over three sleepers before and after the middle one is tamped, and compares what the ballast gave.

    python examples/track/passage.py
    python examples/track/passage.py CASE --axles 20 --set speed=40 --out runs/track

The track (`track.py`) and the bed are coupled implicitly by `ballast.couple`. Between the two series of passages the unit of
`examples/machine` tamps the middle sleeper; the rail, which was straight before, then lies higher there and lifts the
neighbours. Written are `table.md`, `figures.json` and `track.png`, and a checkpoint every 50 windows; `--resume` continues
from it, with the same bytes as an undisturbed run.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path

# The matrices of the track are so small that several threads take longer, above all beside those of the ballast.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import ballast
import numpy as np
import track
from ballast import couple

HERE = Path(__file__).parent
sys.path.append(str(HERE.parent / "machine"))
import machine  # noqa: E402
import tamp as tamp_example  # noqa: E402

PRESS_SPEED = 0.02  # m/s
SERIES = ("before", "after")
#: Options that a resumed run must have as before.
KEPT = ("axles", "consolidation", "seating", "window", "tolerance", "set", "unit")


def arguments():
    parser = argparse.ArgumentParser(description="Run wheels over three sleepers, before and after tamping")
    parser.add_argument("case", nargs="?", default=HERE / "track.toml", help="case file")
    parser.add_argument("--out", type=Path, default=Path("runs/track"), help="folder of the results")
    parser.add_argument("--axles", type=int, default=3, help="wheels of each series")
    parser.add_argument("--consolidation", type=float, default=10e3, help="load that presses each sleeper before, N")
    parser.add_argument("--seating", type=float, default=1e3, help="load that presses the tamped sleeper after tamping, N")
    parser.add_argument("--window", type=int, default=2, help="time steps of a window")
    parser.add_argument("--tolerance", type=float, default=1e-6, help="tolerance of the coupling, m")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="parameter of the track")
    parser.add_argument("--unit", action="append", default=[], metavar="NAME=VALUE", help="parameter of the tamping unit")
    parser.add_argument("--checkpoint", type=int, default=50, metavar="WINDOWS", help="windows from one checkpoint to the next")
    parser.add_argument("--resume", action="store_true", help="continue from the last checkpoint")
    parser.add_argument("--threads", type=int, help="computing threads")
    return parser.parse_args()


def main():
    args = arguments()
    args.out.mkdir(parents=True, exist_ok=True)
    runs, going = {}, None
    if args.resume:
        runs, going = tamp_example.read_checkpoint(args.out / "checkpoint.pickle", args, KEPT)
    with ballast.open(args.case, threads=args.threads) as sim:
        sleepers = [name for name, role in sim.roles.items() if role == "sleeper"]
        # Refused before any work.
        middle = tamped_station(sim).sleeper
        if "before" not in runs:
            if going is None:
                press(sim, sleepers, args.consolidation, cycles=3)
            runs["before"], going = passages(sim, args, runs, going), None
        if "after" not in runs:
            if going is None:
                sim.restore(runs["before"]["start"])
                runs["before"]["tamping"] = tamp(sim, args)
                press(sim, [middle], args.seating)
            runs["after"] = passages(sim, args, runs, going)
        figures = {when: summary(run, model(run, args)) for when, run in runs.items()}
        figures |= {"tamping": runs["before"]["tamping"], "hash": sim.save().hash}
    (args.out / "figures.json").write_text(json.dumps(figures, indent=1))
    text = "\n".join(table(figures))
    (args.out / "table.md").write_text(text + "\n")
    draw(runs, sleepers, args.out / "track.png")
    print(text, f"\n{args.out / 'track.png'}")


def press(sim, sleepers, load, cycles=1):
    """Presses sleepers down until each carries the load, and lifts them until a tenth of it is left."""
    for down, is_reached in [(1, lambda force: force >= load), (-1, lambda force: force <= 0.1 * load)] * cycles:
        moving = list(sleepers)
        while moving:
            t0, t1 = sim.now_ns, sim.now_ns + 5 * sim.step_ns
            way = np.array([0, 0, -down * PRESS_SPEED * (t1 - t0) * 1e-9])
            poses = {name: sim.save().commanded_pose(name) for name in moving}
            result = sim.advance_to(t1, {name: ballast.Motion([t0, t1], [x, x + way], [q, q]) for name, (x, q) in poses.items()})
            check(result)
            moving = [name for name in moving if not is_reached(result[name].mean_force[2])]


def tamped_station(sim):
    """Returns the sleeper that the case tamps, where it is, and its tines."""
    stations = tamp_example.stations(sim)
    if len(stations) != 1:
        raise SystemExit(f"tamped sleepers: expected one, found {len(stations)}; set `tamped` in the case")
    return stations[0]


def tamp(sim, args):
    """Tamps a sleeper with a tamping unit in the loop; returns numbers of windows, and of those not converged."""
    parameters = machine.Parameters.of_case(sim.case, **tamp_example.parsed(args.unit, machine.Parameters))
    unit = machine.TampingUnit([tamped_station(sim)], sim.step_ns * 1e-9, parameters, start=sim.now_ns * 1e-9)
    coupling = couple.Coupling(sim, unit, window_steps=args.window, tolerance=2 * args.tolerance, max_iterations=60)
    converged = []
    while unit.phase != "done":
        converged.append(coupling.advance().is_converged)
        if len(converged) % args.checkpoint == 0:
            print(f"tamping  {unit.phase}", flush=True)
    # The blades stop where they are, above the ballast.
    t0, t1, state = sim.now_ns, sim.now_ns + sim.step_ns, sim.save()
    poses = {name: state.commanded_pose(name) for name in unit.motion()}
    stopped = {name: ballast.Motion([t0, t1], [x, x], [q, q], allow_jump=True) for name, (x, q) in poses.items()}
    check(sim.advance_to(t1, stopped))
    return {"windows": len(converged), "not_converged": converged.count(False)}


def check(result):
    if result.status not in ("ok", "warn"):
        raise SystemExit(f"{result.t1_ns * 1e-9:.4f} s  {result.status}  {result.code}: {result.error_message}")


def model(run, args):
    """Returns the track on the sleepers of a run."""
    parameters = track.Parameters(**tamp_example.parsed(args.set, track.Parameters))
    return track.Track(run["sleepers"], run["start"].time_ns * 1e-9, args.axles, parameters, run["heights"])


def passages(sim, args, runs, going):
    """Lays the track on the sleepers and runs the wheels, from a checkpoint if there is one; returns the run."""
    run, checkpoint = going or (None, None)
    if run is None:
        start = sim.save()
        sleepers = {name: start.body(name)[0] for name, role in sim.roles.items() if role == "sleeper"}
        # The rail has the line on which it was laid before.
        line = runs["before"]["sleepers"] if runs else sleepers
        run = {"start": start, "sleepers": sleepers, "heights": [float(sleepers[name][2] - line[name][2]) for name in sleepers],
               "rows": [], "windows": [], "wall": 0.0}  # fmt: skip
    when, partner = SERIES[len(runs)], model(run, args)
    sim.restore(run["start"])
    coupling = couple.Coupling(sim, partner, window_steps=args.window, tolerance=args.tolerance)
    if checkpoint:
        coupling.restore(checkpoint)
    end = run["start"].time_ns + round(partner.duration() * 1e9)
    while sim.now_ns < end:
        began = time.perf_counter()
        window = coupling.advance()
        run["wall"] += time.perf_counter() - began
        run["rows"].append(partner.trace)
        run["windows"].append([window.iterations, window.is_converged, window.work_given, window.work_received])
        if len(run["windows"]) % args.checkpoint == 0 or sim.now_ns >= end:
            run["energies"] = partner.energies()
            tamp_example.write_checkpoint(args.out / "checkpoint.pickle", args, KEPT, (runs, (run, coupling.save())))
            done = (sim.now_ns - run["start"].time_ns) * 1e-9 / partner.duration()
            print(f"{when} tamping  {100 * min(done, 1):.0f} %  {window.iterations} iterations", flush=True)
    return run


def parts(run):
    """Returns time since the track was laid, place and load of the wheel, and height and force of each sleeper."""
    rows, n = np.concatenate(run["rows"]), len(run["sleepers"])
    return rows[:, 0] - run["start"].time_ns * 1e-9, rows[:, 1], rows[:, 2], rows[:, 3 : 3 + n], rows[:, 3 + n :]


def summary(run, partner):
    p, names = partner.p, partner.names
    t, place, load, height, force = parts(run)
    period, full, middle = partner.period(), p.share * p.wheel_load, len(names) // 2
    weight = p.share * p.sleeper_mass * track.GRAVITY
    axles = []
    for k in range(partner.axles):
        begin = p.seating_time + k * period
        before, during = np.searchsorted(t, begin) - 1, (t > begin) & (t <= begin + period)
        over = during & (load >= 0.999 * full) & (np.abs(place - partner.origins[middle, 0]) < 0.1)
        last = np.flatnonzero(during)[-1]
        axles.append({
            "load_share": float((force[over, middle] - force[before, middle]).mean() / full),
            "deflection": [float(d) for d in height[before] - height[during].min(axis=0)],
            "rest": [float(d) for d in height[before] - height[last]],
            "void": [void(height[before, j], height[during, j], force[before, j], force[during, j], weight) for j in range(len(names))],
        })  # fmt: skip
    iterations, converged, given, received = np.array(run["windows"], dtype=float).T
    rest, e = np.searchsorted(t, p.seating_time) - 1, run["energies"]
    drives = e["gravity"] + e["wheel load"] + e["traction"] + e["laying"]
    return {
        "names": names, "heights": run["heights"], "axles": axles, "rest_force": [float(f) for f in force[rest]],
        "settlement": [float(d) for d in height[rest] - height[-1]],
        "windows": len(iterations), "median_iterations": float(np.median(iterations)), "max_iterations": int(iterations.max()),
        "not_converged": int((converged == 0).sum()), "work_exchanged": float(np.abs(given).sum()),
        "energy_lost": float(np.abs(given - received).sum()), "work_received": float(received.sum()),
        "energies": e, "drives": drives, "balance_error": drives - e["stored"] - e["dampers"] - float(received.sum()),
        "wall": run["wall"],
    }  # fmt: skip


def void(height, heights, force, forces, weight):
    """Returns the way of a hanging sleeper under a wheel until the ballast carries its weight, m; 0 if it does so before."""
    carried = np.flatnonzero(forces >= weight)
    return 0.0 if force >= weight else float(height - (heights[carried[0]] if len(carried) else heights.min()))


def table(figures):
    """Yields the lines of the table."""
    yield from ("| figure | before tamping | after tamping |", "|---|---|---|")
    pair = [figures[when] for when in SERIES]
    middle = len(pair[0]["names"]) // 2

    def row(label, value):
        return f"| {label} | {' | '.join(value(f) for f in pair)} |"

    def millimetres(values):
        return ", ".join(f"{v * 1e3:.2f}" for v in values)

    yield row("height of the rail's line above that before, by sleeper, mm", lambda f: millimetres(f["heights"]))
    yield row("force of the ballast before the first wheel, by sleeper, N", lambda f: ", ".join(f"{v:.0f}" for v in f["rest_force"]))
    for label, k in (("first", 0), ("last", -1)):
        yield row(f"void under the sleepers at the {label} axle, mm", lambda f, k=k: millimetres(f["axles"][k]["void"]))
    yield row("load share of the middle sleeper by axle, %", lambda f: ", ".join(f"{a['load_share'] * 100:.1f}" for a in f["axles"]))
    for key in ("deflection", "rest"):
        yield row(f"{key} of the middle sleeper by axle, mm", lambda f, key=key: millimetres(a[key][middle] for a in f["axles"]))
    yield row("settlement of the sleepers over all axles, mm", lambda f: millimetres(f["settlement"]))
    yield row("work on the ballast, J", lambda f: f"{f['work_received']:.2f}")
    yield row("energy lost at the interface, J", lambda f: f"{f['energy_lost']:.4f}")
    yield row("work of the drives, stored, in dampers, J",
              lambda f: ", ".join(f"{v:.2f}" for v in (f["drives"], f["energies"]["stored"], f["energies"]["dampers"])))  # fmt: skip
    yield row("error of the energy balance, J", lambda f: f"{f['balance_error']:.3f}")
    yield row("windows; iterations, median and largest",
              lambda f: f"{f['windows']}; {f['median_iterations']:.0f}, {f['max_iterations']}")  # fmt: skip
    yield row("windows not converged", lambda f: str(f["not_converged"]))
    yield row("wall time, s", lambda f: f"{f['wall']:.0f}")
    t = figures["tamping"]
    yield f"| windows of the tamping, and those not converged | | {t['windows']}, {t['not_converged']} |"


def draw(runs, sleepers, path):
    """Plots heights and loads of the sleepers over time, before and after."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(12, 7), layout="constrained", sharey="row", sharex="col")
    for column, (when, run) in enumerate(runs.items()):
        t, _, load, height, force = parts(run)
        for k, name in enumerate(sleepers):
            axes[0, column].plot(t, height[:, k] * 1e3, label=name)
            axes[1, column].plot(t, force[:, k] / 1e3, lw=0.8, label=name)
        axes[1, column].plot(t, load / 1e3, "k--", lw=0.8, label="wheel")
        axes[0, column].set(title=f"{when} tamping", ylabel="height of the sleepers, mm")
        axes[1, column].set(xlabel="time, s", ylabel="force of the ballast, kN")
    for ax in axes.flat:
        ax.grid(alpha=0.3)
        ax.legend(fontsize="x-small")
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()

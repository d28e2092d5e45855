"""Runs wheels over three sleepers before and after the middle one is tamped, and compares what the ballast gave.

    python examples/track/passage.py
    python examples/track/passage.py CASE --axles 5 --set speed=40 --out runs/track

The track (`track.py`) and the bed are coupled implicitly by `ballast.couple`. Between the two series of passages the case's
cycle tamps the middle sleeper; the rail is then laid again without stress. Written are `table.md`, `figures.json` and
`track.png`.
"""

import argparse
import json
import time
from pathlib import Path

import ballast
import numpy as np
import track
from ballast import couple

HERE = Path(__file__).parent
PRESS_SPEED = 0.02  # m/s


def arguments():
    parser = argparse.ArgumentParser(description="Run wheels over three sleepers, before and after tamping")
    parser.add_argument("case", nargs="?", default=HERE / "track.toml", help="case file")
    parser.add_argument("--out", type=Path, default=Path("runs/track"), help="folder of the results")
    parser.add_argument("--axles", type=int, default=3, help="wheels of each series")
    parser.add_argument("--consolidation", type=float, default=20e3, help="load that presses each sleeper before, N")
    parser.add_argument("--seating", type=float, default=1e3, help="load that presses each sleeper after tamping, N")
    parser.add_argument("--window", type=int, default=2, help="time steps of a window")
    parser.add_argument("--tolerance", type=float, default=1e-6, help="tolerance of the coupling, m")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="parameter of the track")
    parser.add_argument("--threads", type=int, help="computing threads")
    return parser.parse_args()


def main():
    args = arguments()
    args.out.mkdir(parents=True, exist_ok=True)
    with ballast.open(args.case, threads=args.threads) as sim:
        press(sim, args.consolidation, cycles=3)
        series = {"before": passages(sim, args)}
        print("before tamping: done", flush=True)
        sim.restore(series["before"].pop("start"))
        for _ in range(sim.case.duration_ns // sim.step_ns):
            result = sim.step_tamping_cycle()
            if result.status not in ("ok", "warn"):
                raise SystemExit(f"{result.t1_ns * 1e-9:.4f} s  {result.status}  {result.code}: {result.error_message}")
        # The sleepers are let down until the ballast carries them.
        press(sim, args.seating)
        print("tamping: done", flush=True)
        series["after"] = passages(sim, args)
        del series["after"]["start"]
    figures = {when: summary(run) for when, run in series.items()}
    (args.out / "figures.json").write_text(json.dumps(figures, indent=1))
    text = "\n".join(table(figures))
    (args.out / "table.md").write_text(text + "\n")
    draw(series, figures, args.out / "track.png")
    print(text, f"\n{args.out / 'track.png'}")


def press(sim, load, cycles=1):
    """Presses all sleepers down until each carries the load, and lifts them until a tenth of it is left."""
    for down, is_reached in [(1, lambda force: force >= load), (-1, lambda force: force <= 0.1 * load)] * cycles:
        moving = [name for name, role in sim.roles.items() if role == "sleeper"]
        while moving:
            t0, t1 = sim.now_ns, sim.now_ns + 5 * sim.step_ns
            way = np.array([0, 0, -down * PRESS_SPEED * (t1 - t0) * 1e-9])
            poses = {name: sim.save().commanded_pose(name) for name in moving}
            result = sim.advance_to(t1, {name: ballast.Motion([t0, t1], [x, x + way], [q, q]) for name, (x, q) in poses.items()})
            if result.status not in ("ok", "warn"):
                raise SystemExit(f"{t1 * 1e-9:.4f} s  {result.status}  {result.code}: {result.error_message}")
            moving = [name for name in moving if not is_reached(result[name].mean_force[2])]


def passages(sim, args):
    """Lays the track on the sleepers and runs the wheels."""
    start = sim.save()
    sleepers = {name: start.body(name)[0] for name, role in sim.roles.items() if role == "sleeper"}
    others = {name: float(value) for name, value in (text.split("=") for text in args.set)}
    model = track.Track(sleepers, sim.now_ns * 1e-9, args.axles, track.Parameters(**others))
    coupling = couple.Coupling(sim, model, window_steps=args.window, tolerance=args.tolerance)
    end, rows, windows, began = sim.now_ns + round(model.duration() * 1e9), [], [], time.perf_counter()
    while sim.now_ns < end:
        windows.append(coupling.advance())
        rows.append(model.trace)
    return {"start": start, "model": model, "trace": np.concatenate(rows), "windows": windows,
            "wall": time.perf_counter() - began}  # fmt: skip


def parts(run):
    """Returns time since the track was laid, place and load of the wheel, and height and force of each sleeper."""
    rows, n = run["trace"], len(run["model"].names)
    return rows[:, 0] - run["model"].start, rows[:, 1], rows[:, 2], rows[:, 3 : 3 + n], rows[:, 3 + n :]


def summary(run):
    model = run["model"]
    t, place, load, height, force = parts(run)
    seated, period = model.p.seating_time, model.period()
    full = model.p.share * model.p.wheel_load
    middle = len(model.names) // 2
    axles = []
    for k in range(model.axles):
        begin = seated + k * period
        before, during = np.searchsorted(t, begin) - 1, (t > begin) & (t <= begin + period)
        over = during & (load >= 0.999 * full) & (np.abs(place - model.origins[middle, 0]) < 0.1)
        last = np.flatnonzero(during)[-1]
        axles.append({
            "load_share": float((force[over, middle] - force[before, middle]).mean() / full),
            "deflection": [float(d) for d in height[before] - height[during].min(axis=0)],
            "rest": [float(d) for d in height[before] - height[last]],
        })  # fmt: skip
    iterations = np.array([w.iterations for w in run["windows"]])
    given = sum(w.work_given for w in run["windows"])
    return {
        "names": model.names, "axles": axles,
        "settlement": [float(d) for d in height[np.searchsorted(t, seated) - 1] - height[-1]],
        "windows": len(iterations), "median_iterations": float(np.median(iterations)), "max_iterations": int(iterations.max()),
        "not_converged": sum(not w.is_converged for w in run["windows"]), "work_given": given,
        "energy_lost": sum(abs(w.energy_residual) for w in run["windows"]),
        "work_exchanged": sum(abs(w.work_given) for w in run["windows"]),
        "work_received": sum(w.work_received for w in run["windows"]), "wall": run["wall"],
    }  # fmt: skip


def table(figures):
    """Yields the lines of the table."""
    yield from ("| figure | before tamping | after tamping |", "|---|---|---|")
    pair = [figures["before"], figures["after"]]
    middle = len(pair[0]["names"]) // 2

    def row(label, value):
        return f"| {label} | {' | '.join(value(f) for f in pair)} |"

    yield row("load share of the middle sleeper by axle, %", lambda f: ", ".join(f"{a['load_share'] * 100:.2f}" for a in f["axles"]))
    for key in ("deflection", "rest"):
        yield row(f"{key} of the middle sleeper by axle, mm",
                  lambda f, key=key: ", ".join(f"{a[key][middle] * 1e3:.2f}" for a in f["axles"]))  # fmt: skip
    yield row("settlement of the sleepers over all axles, mm", lambda f: ", ".join(f"{s * 1e3:.2f}" for s in f["settlement"]))
    yield row("work on the ballast, J", lambda f: f"{f['work_received']:.2f}")
    yield row("energy lost at the interface, J", lambda f: f"{f['energy_lost']:.4f}")
    yield row("windows; iterations, median and largest",
              lambda f: f"{f['windows']}; {f['median_iterations']:.0f}, {f['max_iterations']}")  # fmt: skip
    yield row("windows not converged", lambda f: str(f["not_converged"]))
    yield row("wall time, s", lambda f: f"{f['wall']:.0f}")


def draw(series, figures, path):
    """Plots heights and loads of the sleepers over time, before and after."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(12, 7), layout="constrained", sharey="row", sharex="col")
    for column, (when, run) in enumerate(series.items()):
        t, _, load, height, force = parts(run)
        for k, name in enumerate(run["model"].names):
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

"""Tamps a bed with a model of a tamping unit in the loop, and reports what the machine and the ballast did.

    python examples/machine/tamp.py
    python examples/machine/tamp.py CASE --out runs/machine --scheme staggered --window 2
    python examples/machine/tamp.py examples/machine/walk.toml --out runs/walk
    python examples/machine/tamp.py CASE --connect zenoh:demo/bed

The unit (`machine.py`) and the bed are coupled by `ballast.couple`. It tamps all tamped sleepers of the case in turn. The
run ends with a table on the terminal, in `table.md` and `figures.json`, and with a page to send, `report.html`. It writes
a checkpoint every 50 windows; `--resume` continues from it, with the same bytes as an undisturbed run. The bed can also be
one that `ballast serve CASE` computes; it has no zones and no probes here, and keeps its part of the last checkpoint.
"""

import argparse
import base64
import html
import json
import pickle
import time
from pathlib import Path

import ballast
import machine
import numpy as np
from ballast import couple

HERE = Path(__file__).parent
#: Options that a resumed run must have as before.
KEPT = ("seed", "scheme", "acceleration", "window", "tolerance", "max_iterations", "pairs", "imposed", "probe", "set")


def arguments(texts=None):
    parser = argparse.ArgumentParser(description="Tamp a bed with a model of a tamping unit in the loop")
    parser.add_argument("case", nargs="?", default=HERE / "tamping.toml", help="case file")
    parser.add_argument("--seed", type=int, help="seed of the bed (default: the case's)")
    parser.add_argument("--connect", metavar="zenoh:SITE/ID", help="served component that computes the bed")
    parser.add_argument("--endpoint", help="endpoint of the served component (default: tcp/127.0.0.1:7447)")
    parser.add_argument("--out", type=Path, default=Path("runs/machine"), help="folder of the results")
    parser.add_argument("--scheme", choices=couple.SCHEMES, default="implicit", help="coupling scheme")
    parser.add_argument("--acceleration", choices=couple.ACCELERATIONS, default="iqn-ils", help="acceleration")
    parser.add_argument("--window", type=int, default=2, help="time steps of a window")
    parser.add_argument("--tolerance", type=float, default=2e-6, help="tolerance of the implicit scheme, m")
    parser.add_argument("--max-iterations", type=int, default=60, help="largest number of iterations of a window")
    parser.add_argument("--pairs", default="", help="pairs that squeeze in each cycle, such as 0/0,1; default: one cycle of all")
    parser.add_argument("--imposed", action="store_true", help="impose the motion of the unit without load")
    parser.add_argument("--probe", type=float, default=0, metavar="N", help="load that probes the support of the sleepers, N")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="parameter of the unit")
    parser.add_argument("--windows", type=int, default=10**9, help="largest number of windows")
    parser.add_argument("--checkpoint", type=int, default=50, metavar="WINDOWS", help="windows from one checkpoint to the next")
    parser.add_argument("--resume", action="store_true", help="continue from the last checkpoint")
    parser.add_argument("--threads", type=int, help="computing threads")
    return parser.parse_args(texts)


def main():
    args = arguments()
    args.out.mkdir(parents=True, exist_ok=True)
    with open_simulation(args) as sim:
        if args.connect and sim.now_ns > 0 and not args.resume:
            raise SystemExit(f"{args.connect}: expected a run at its start, found one at {sim.now_ns * 1e-9:.4f} s; serve it with --force, or --resume")
        saved = args.out / "checkpoint.pickle"
        checkpoint, run = read_checkpoint(saved, args, KEPT) if args.resume else (None, new_run(sim, args))
        coupling, unit = couple_unit(sim, ballast.Case.load(args.case), args, run["places"])
        if checkpoint:
            coupling.restore(checkpoint)
        else:
            run["support"].append(support(sim, unit, args))
        for window in cycle_windows(coupling, unit, run, args):
            if len(run["windows"]) % args.checkpoint == 0:
                # A served bed keeps its part of a checkpoint while the checkpoint is referenced.
                checkpoint = coupling.save()
                write_checkpoint(saved, args, KEPT, (checkpoint, run))
                print(f"{sim.now_ns * 1e-9:.3f} s  {unit.phase}  {window.iterations} iterations", flush=True)
        run["support"].append(support(sim, unit, args))
        figures = summary(run, unit, sim)
    lines = write_figures(figures, args.out)
    draw(run, unit, args.out / "machine.png")
    write_report(lines, args.out / "machine.png", args.out / "report.html")
    print("\n".join(lines), f"\n{args.out / 'report.html'}")


def open_simulation(args):
    """Returns the simulation of the bed, here or served."""
    if args.connect:
        return ballast.open(args.connect, connect=args.endpoint)
    return ballast.open(args.case, seed=args.seed, threads=args.threads)


def parsed(texts, parameters):
    """Returns values by name from texts such as "speed=40", with the types of the defaults of a class of parameters."""
    values = dict(text.split("=") for text in texts)
    return {name: type(getattr(parameters, name))(value) for name, value in values.items()}


def new_run(sim, args):
    return {"rows": [], "windows": [], "wall": 0.0, "compactness": [compactness(sim, args)], "support": [],
            "places": sleeper_places(sim)}  # fmt: skip


def cycle_windows(coupling, unit, run, args):
    """Advances both sides until the unit is done, keeps what they do and yields each window."""
    while unit.phase != "done" and len(run["windows"]) < args.windows:
        phase, began = unit.phase, time.perf_counter()
        window = coupling.advance()
        run["wall"] += time.perf_counter() - began
        keep(run, window, unit, phase)
        if unit.phase != phase and unit.phase in ("travel", "done"):
            run["compactness"].append(compactness(coupling.sim, args))
        yield window


def couple_unit(sim, case, args, places=None):
    """Returns the coupling of a simulation and a tamping unit, and the unit; `places` are those of the sleepers at the start."""
    pairs = [[int(k) for k in cycle.split(",")] for cycle in args.pairs.split("/")] if args.pairs else None
    parameters = machine.Parameters.of_case(case, **parsed(args.set, machine.Parameters))
    unit = machine.TampingUnit(stations(sim, places), sim.step_ns * 1e-9, parameters, pairs, is_loaded=not args.imposed)
    scheme = "staggered" if args.imposed else args.scheme
    return couple.Coupling(sim, unit, scheme, window_steps=args.window, acceleration=args.acceleration,
                           tolerance=args.tolerance, max_iterations=args.max_iterations), unit  # fmt: skip


def sleeper_places(sim):
    state = sim.save()
    return {name: state.commanded_pose(name)[0] for name, role in sim.roles.items() if role == "sleeper"}


def stations(sim, places=None):
    """Returns the tamped sleepers along the track, each with the tines nearest to it; `places`: those of the sleepers now."""
    places, tines = places or sleeper_places(sim), {}
    for tine in sim.tines:
        tines.setdefault(min(places, key=lambda name: abs(places[name][0] - tine.start[0])), []).append(tine)
    if not tines:
        raise SystemExit("tines: expected a case with tines and [tamping], found none")
    return [machine.Station(tines[name], name, places[name]) for name in sorted(tines, key=lambda name: places[name][0])]


def compactness(sim, args):
    zones = {} if args.connect else sim.zones()
    return {name: zone.compactness for name, zone in zones.items() if zone.compactness is not None}


def support(sim, unit, args):
    """Returns support stiffness (N/m) and rest (m) of each tamped sleeper under a load; empty without one."""
    names = [station.sleeper for station in unit.stations] if args.probe and not args.connect else []
    probes = {name: sim.probe_stiffness(name, max_load=args.probe, min_load=0.1 * args.probe)["cycles"][-1] for name in names}
    return {name: {key: probe[key] for key in ("loading", "unloading", "rest")} for name, probe in probes.items()}


def write_checkpoint(path, args, kept, state):
    """Writes a state and the options of its run to a file that is complete whenever the program is killed."""
    part = path.with_suffix(".part")
    part.write_bytes(pickle.dumps(({name: getattr(args, name) for name in kept}, state)))
    part.replace(path)


def read_checkpoint(path, args, kept):
    """Returns the state of a checkpoint whose options are those given."""
    if not path.exists():
        raise SystemExit(f"{path}: expected a checkpoint, found none; run without --resume")
    options, state = pickle.loads(path.read_bytes())
    for name in kept:
        if options[name] != getattr(args, name):
            option = "--" + name.replace("_", "-")
            raise SystemExit(f"{option}: expected {options[name]!r} as before, found {getattr(args, name)!r}")
    return state


def keep(run, window, unit, phase):
    run["rows"].append(unit.trace)
    arms = [tine.name for tine in unit.stations[unit.station].tines]
    tines = sum(window.result[name].work for name in unit.names)
    run["windows"].append({
        "t1": window.result.t1_ns * 1e-9, "phase": phase, "cycle": unit.logic["cycle"] + 1, "iterations": window.iterations,
        "residual": window.residual, "is_converged": window.is_converged, "given": window.work_given,
        "received": window.work_received, "tines": tines,
        "pair_work": [sum(window.result[n].work for n, k in zip(arms, unit.pair_of, strict=True) if k == pair)
                      for pair in range(len(unit.arms_of))],
        "steps": window.result.steps, "steps_not_converged": window.result.solver.steps_not_converged,
    })  # fmt: skip


def columns(run, unit):
    """Returns the trace of the run by name: (n,), or (n, arms) and (n, pairs)."""
    rows = np.concatenate(run["rows"])
    found, end = {}, 0
    for names, size in ((machine.TRACE, 1), (machine.ARM_TRACE, len(unit.signs)), (machine.PAIR_TRACE, len(unit.arms_of))):
        for name in names:
            found[name] = rows[:, end] if size == 1 and names is machine.TRACE else rows[:, end : end + size]
            end += size
    return found


def smooth(values, steps):
    """Returns moving means over a number of steps."""
    return np.apply_along_axis(lambda v: np.convolve(v, np.ones(steps) / steps, "same"), 0, values)


def summary(run, unit, sim):
    windows, trace, energies = run["windows"], columns(run, unit), unit.energies()
    period = max(1, round(1 / (unit.p.frequency * unit.step)))
    iterations = np.array([w["iterations"] for w in windows])
    drives = energies["pump"] + energies["eccentric motor"] + energies["lifting drive"]
    received = sum(w["received"] for w in windows)
    lost = energies["valves"] + energies["friction"] + energies["leakage and relief"]
    mean_force, pairs = smooth(trace["force"], period), {}
    for squeeze in unit.logic["squeezes"]:
        [station] = [s for s in unit.stations if s.sleeper == squeeze["sleeper"]]
        number = station.pairs().index(squeeze["pair"])
        is_mine = [w["phase"] == "squeeze" and w["cycle"] == squeeze["cycle"] for w in windows]
        steps = np.repeat(is_mine, [w["steps"] for w in windows])
        pairs[f"cycle {squeeze['cycle']}, {squeeze['sleeper']}, pair {squeeze['pair']}"] = squeeze | {
            "work": sum(w["pair_work"][number] for w, mine in zip(windows, is_mine, strict=True) if mine),
            "mean_force": float(mean_force[steps][:, unit.pair_of == number].max(initial=0.0)),
        }
    return {
        "hash": sim.save().hash, "phase": unit.phase, "time": windows[-1]["t1"], "wall": run["wall"], "windows": len(windows),
        "iterations": {"median": float(np.median(iterations)), "mean": float(iterations.mean()), "max": int(iterations.max())},
        "not_converged": sum(not w["is_converged"] for w in windows),
        "steps": sum(w["steps"] for w in windows), "steps_not_converged": sum(w["steps_not_converged"] for w in windows),
        "peak_pressure": float(trace["pressure"].max()), "peak_force": float(trace["force"].max()),
        "peak_mean_force": float(mean_force.max()), "is_loaded": unit.is_loaded,
        "depth": float(trace["depth"].max()), "full_depth": unit.travel,
        "squeezes": pairs, "compactness": run["compactness"], "support": run["support"], "energies": energies,
        "drives": drives, "received": received, "given": sum(w["given"] for w in windows),
        "balance_error": drives - energies["stored"] - lost - received,
        "interface_error": sum(abs(w["given"] - w["received"]) for w in windows),
    }  # fmt: skip


def write_figures(figures, folder):
    """Writes figures and their table; returns the lines of the table."""
    (folder / "figures.json").write_text(json.dumps(figures, indent=1))
    lines = list(table(figures))
    (folder / "table.md").write_text("\n".join(lines) + "\n")
    return lines


def table(f):
    """Yields the lines of the table."""
    yield from ("| figure | value |", "|---|---|")
    yield f"| cycle | {f['phase']} at {f['time']:.3f} s, depth {f['depth'] * 1e3:.0f} of {f['full_depth'] * 1e3:.0f} mm |"
    yield f"| peak load pressure of a cylinder | {f['peak_pressure'] / 1e5:.0f} bar |"
    yield f"| peak closing force of a tine, step / period mean | {f['peak_force']:.0f} / {f['peak_mean_force']:.0f} N |"
    for name, s in f["squeezes"].items():
        yield (f"| {name} | stop by {s['cause']} at {s['closing'] * 1e3:.1f} mm and {s['pressure'] / 1e5:.1f} bar; work "
               f"{s['work']:.0f} J; peak mean force {s['mean_force']:.0f} N |")  # fmt: skip
    for zone in f["compactness"][0]:
        values = [f"{measured[zone]:.3f}" for measured in f["compactness"] if zone in measured]
        yield f"| compactness of {zone}, before and after each sleeper | {' → '.join(values)} |"
    for name in f["support"][0]:
        before, after = f["support"][0][name], f["support"][-1][name]
        for key, unit, factor in (("loading", "kN/mm", 1e-6), ("unloading", "kN/mm", 1e-6), ("rest", "mm", 1e3)):
            what = "rest after the load" if key == "rest" else f"support in {key}"
            yield f"| {name}: {what}, before and after | {before[key] * factor:.2f} → {after[key] * factor:.2f} {unit} |"
    i = f["iterations"]
    yield f"| windows, iterations | {f['windows']}; median {i['median']:.0f}, mean {i['mean']:.1f}, largest {i['max']} |"
    yield f"| windows not converged | {f['not_converged']} |"
    yield f"| time steps not converged | {f['steps_not_converged']} of {f['steps']} |"
    if not f["is_loaded"]:
        yield f"| given to the ballast by the imposed motion | {f['received']:.0f} J |"
        yield f"| hash of the ballast at the end | {f['hash']} |"
        return
    e = f["energies"]
    yield (f"| work of the drives | {f['drives']:.0f} J: pump {e['pump']:.0f}, eccentric motor {e['eccentric motor']:.0f}, "
           f"lifting {e['lifting drive']:.0f} |")  # fmt: skip
    lost = [e[name] for name in ("valves", "friction", "leakage and relief")]
    yield (f"| stored and dissipated in the machine | {e['stored']:.0f} J and {sum(lost):.0f} J: valves {lost[0]:.0f}, "
           f"friction {lost[1]:.0f}, leakage and relief {lost[2]:.0f} |")  # fmt: skip
    yield f"| given to the ballast, by the machine and by the ballast | {f['given']:.1f} J, {f['received']:.1f} J |"
    share = 100 * f["balance_error"] / f["drives"] if f["drives"] else 0.0
    yield f"| error of the energy balance | {f['balance_error']:.1f} J, {share:.2f} % of the work of the drives |"
    yield f"| wall time of the coupling | {f['wall']:.0f} s |"
    yield f"| hash of the ballast at the end | {f['hash']} |"


def draw(run, unit, path):
    """Plots pressures, forces, motion and iterations over time, and force over closing."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    trace, windows = columns(run, unit), run["windows"]
    t, period = trace["time"], max(1, round(1 / (unit.p.frequency * unit.step)))
    figure, axes = plt.subplots(3, 2, figsize=(13, 10), layout="constrained")
    motion, loops, pressure, work, force, iterations = axes.flat
    motion.plot(t, trace["depth"] * 1e3, "k", label="depth of the unit")
    # Forces and motions are those of the arms, wherever the unit is.
    for k, name in enumerate(tine.name if len(unit.stations) == 1 else f"arm {k + 1}" for k, tine in enumerate(unit.stations[0].tines)):
        colour = f"C{k}"
        motion.plot(t, trace["closing"][:, k] * 1e3, colour, lw=0.8, label=name)
        pressure.plot(t, trace["pressure"][:, k] / 1e5, colour, lw=0.4, alpha=0.6)
        force.plot(t, trace["force"][:, k] / 1e3, colour, lw=0.3, alpha=0.5)
        mean = smooth(trace["force"][:, [k]], period)[:, 0] / 1e3
        force.plot(t, mean, colour, lw=1.5, label=name)
        closing = smooth(trace["closing"][:, [k]], period)[:, 0] * 1e3
        squeezed = np.repeat([w["phase"] in ("squeeze", "hold") for w in windows], [w["steps"] for w in windows])
        loops.plot(np.where(squeezed, closing, np.nan), np.where(squeezed, mean, np.nan), colour, label=name)
    for k, pair in enumerate(unit.stations[0].pairs() if len(unit.stations) == 1 else range(len(unit.arms_of))):
        pressure.plot(t, trace["load_pressure"][:, k] / 1e5, f"C{4 + k}", lw=2, label=f"sensor of pair {pair}")
    pressure.plot(t, trace["supply"] / 1e5, "k", lw=0.8, label="supply")
    pressure.axhline(unit.p.preset_pressure / 1e5, color="grey", ls="--", lw=0.8, label="preset")
    ends = [w["t1"] for w in windows]
    work.plot(ends, np.cumsum([w["tines"] for w in windows]), label="tines")
    work.plot(ends, np.cumsum([w["received"] - w["tines"] for w in windows]), label="sleeper")
    iterations.plot(ends, [w["iterations"] for w in windows], ".", ms=3)
    for ax, title, label in (
        (motion, "motion", "mm"), (loops, "squeeze: force over closing, period means", "kN"),
        (pressure, "load pressure of the cylinders", "bar"), (work, "work on the ballast", "J"),
        (force, "closing force at the tines", "kN"), (iterations, "iterations of the coupling", "")):  # fmt: skip
        ax.set(title=title, ylabel=label, xlabel="closing, mm" if ax is loops else "time, s")
        ax.grid(alpha=0.3)
        if ax is not iterations:
            ax.legend(fontsize="x-small")
    begins = [(a["t1"], a["phase"]) for a, b in zip(windows[1:], windows, strict=False) if a["phase"] != b["phase"]]
    for ax in (motion, pressure, work, force, iterations):
        for at, _ in begins:
            ax.axvline(at, color="grey", lw=0.5)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def write_report(lines, picture, path):
    """Writes a page that holds the table and the picture."""
    rows = [[html.escape(cell.strip()) for cell in line.strip("| ").split(" | ")] for line in lines[2:]]
    body = "".join(f"<tr><td>{name}</td><td>{value}</td></tr>" for name, value in rows)
    image = base64.b64encode(picture.read_bytes()).decode()
    path.write_text(f"""<!doctype html>
<html lang="en"><meta charset="utf-8"><title>Tamping with a machine in the loop</title>
<style>body {{ font: 15px sans-serif; max-width: 1100px; margin: 2em auto }} img {{ width: 100% }}
td {{ padding: 3px 1em 3px 0; border-bottom: 1px solid #ddd; vertical-align: top }}</style>
<h1>Tamping with a machine in the loop</h1>
<table>{body}</table>
<img src="data:image/png;base64,{image}" alt="Motion, pressures, forces, loops, work and iterations over time">
</html>
""")


if __name__ == "__main__":
    main()

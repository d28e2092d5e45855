"""Studies how the window length changes the loads of a tamping cycle, compared with the scatter over seeds.

    python examples/python/window_study.py [CASE [FOLDER [STEPS [SEEDS [JOBS]]]]]
    python examples/python/window_study.py benches/cases/laptop_rigid.toml runs/windows 4,2 1,2,3,4 2

The case's tamping cycle runs on the bed of every seed, step by step. Its motion is then replayed on the same bed in windows of
STEPS steps, as a partner would command it: one knot at each end of a window, with the velocity there (cubic), and for the first
seed also held. Impulses and work are summed by phase. A stopped study continues where it was; another case or version of the
package has separate runs in the folder.
"""

import hashlib
import json
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import ballast
import matplotlib
import numpy as np
from ballast import study
from scipy import stats
from scipy.interpolate import CubicSpline

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

FIGURES = ["closing impulse of the tines, N s", "vertical impulse of the tines, N s",
           "vertical impulse of the sleepers, N s", "work of the tines, J"]  # fmt: skip


class Tally:
    """Sums of impulses and work by phase, and quality of a run; prints progress."""

    def __init__(self, sim, steps, label):
        self.total_steps, self.label, self.printed = steps, label, 0
        self.closing = {tine.name: tine.direction for tine in sim.tines}
        self.sleepers = [name for name, role in sim.roles.items() if role == "sleeper"]
        self.phases, self.steps, self.capped, self.deepest = {}, 0, 0, 0.0
        self.before = {name: zone.compactness for name, zone in sim.zones().items()}

    def add(self, phase, out):
        if out.status not in ("ok", "warn"):
            sys.exit(f"the window up to {out.t1_ns} ns ended {out.status}: {out.error_message}")
        row = self.phases.setdefault(phase, [0.0] * len(FIGURES))
        for name, direction in self.closing.items():
            # The ballast's impulse on the tine opposes its motion.
            row[0] -= direction * out[name].impulse[0]
            row[1] += out[name].impulse[2]
            row[3] += out[name].work
        row[2] += sum(out[name].impulse[2] for name in self.sleepers)
        self.steps += out.steps
        self.capped += out.solver.steps_not_converged
        self.deepest = max(self.deepest, out.solver.max_penetration)
        if 10 * self.steps // self.total_steps > self.printed:
            self.printed = 10 * self.steps // self.total_steps
            print(f"{self.label}: {10 * self.printed} %", flush=True)

    def result(self, sim):
        after = {name: zone.compactness for name, zone in sim.zones().items()}
        return {"phases": self.phases, "before": self.before, "after": after, "steps": self.steps,
                "capped": self.capped, "max_penetration_m": self.deepest}  # fmt: skip


def runs_folder(case, folder):
    """Returns the folder of a case's runs, named by a hash of what they depend on."""
    read = ballast.Case.load(case)
    identity = json.dumps([ballast.__version__, read.text, read.bed_key])
    return folder / hashlib.sha256(identity.encode()).hexdigest()[:12]


def begin(case, seed, folder):
    chosen = study.apply(ballast.Case.load(case), {"seed": seed})
    return chosen, ballast.open(chosen, bed_cache=str(folder.parent / "beds"), threads=1, progress=False)


def tamp(case, seed, folder):
    """Runs the case's tamping cycle and writes the motion of its bodies."""
    chosen, sim = begin(case, seed, folder)
    with sim:
        steps = chosen.duration_ns // chosen.step_ns
        tally, phases, times = Tally(sim, steps, f"seed {seed}, machine"), [], [sim.now_ns]
        ways = {name: [np.hstack(sim.save().commanded_pose(name))] for name in sim.bodies}
        for _ in range(steps):
            phases.append(sim.phase)
            tally.add(phases[-1], sim.step_tamping_cycle())
            times.append(sim.now_ns)
            state = sim.save()
            for name, way in ways.items():
                way.append(np.hstack(state.commanded_pose(name)))
        moved = {name: np.array(way).tolist() for name, way in ways.items() if np.ptp(way, axis=0).any()}
        keep(folder / f"motion_{seed}.json", {"times_ns": times, "phases": phases, **moved})
        return tally.result(sim)


def replay(case, seed, folder, kind, n):
    """Replays the motion in windows of at most `n` steps, which also end with each phase."""
    motion = json.loads((folder / f"motion_{seed}.json").read_text())
    times, phases = motion.pop("times_ns"), motion.pop("phases")
    _, sim = begin(case, seed, folder)
    seconds = 1e-9 * np.array(times)
    ways = {name: np.array(way) for name, way in motion.items()}
    speeds = {name: CubicSpline(seconds, way[:, :3])(seconds, 1) for name, way in ways.items()}
    with sim:
        tally, a = Tally(sim, len(phases), f"seed {seed}, {kind}, windows of {n} steps"), 0
        while a < len(phases):
            b = next((i for i in range(a + 1, a + n) if phases[i : i + 1] != [phases[a]]), a + n)
            ends = [a] if kind == "hold" else [a, b]
            # The first cubic motion starts with the velocity of the spline instead of rest.
            motions = {
                name: ballast.Motion([times[i] for i in ends], way[ends, :3], way[ends, 3:],
                                     velocities=speeds[name][ends] if kind == "hermite" else None,
                                     interpolation=kind, allow_jump=kind == "hold" or a == 0)
                for name, way in ways.items()
            }  # fmt: skip
            tally.add(phases[a], sim.advance_to(times[b], motions))
            a = b
        return tally.result(sim)


def keep(path, values):
    half = path.with_suffix(".part")
    half.write_text(json.dumps(values))
    half.replace(path)


def file_of(folder, seed, kind, n):
    return folder / f"{kind}_{n}_{seed}.json"


def run(case, folder, seed, kind, n):
    result = tamp(case, seed, folder) if kind == "machine" else replay(case, seed, folder, kind, n)
    keep(file_of(folder, seed, kind, n), result)


def compute(case, folder, wanted, jobs):
    left = [w for w in wanted if not file_of(folder, *w).exists()]
    # Motions must exist before they are replayed.
    for group in ([w for w in left if w[1] == "machine"], [w for w in left if w[1] != "machine"]):
        with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
            for done in as_completed([pool.submit(run, case, folder, *w) for w in group]):
                done.result()
    return {w: json.loads(file_of(folder, *w).read_text()) for w in wanted}


def draw(runs, seeds, steps, path):
    """Plots every figure by phase: a dot for the bed of each seed and each kind of replay."""
    phases = list(runs[seeds[0], "machine", 1]["phases"])
    marks = {("hermite", n): (seeds, f"cubic, {n} steps, all beds") for n in steps}
    marks["hold", steps[0]] = (seeds[:1], f"held, {steps[0]} steps, the first bed")
    figure, axes = plt.subplots(1, len(FIGURES), figsize=(16, 4), layout="constrained")
    for k, (ax, label) in enumerate(zip(axes, FIGURES, strict=True)):
        for i, phase in enumerate(phases):
            for j, (kind, (beds, name)) in enumerate(marks.items()):
                values = [figure_of(runs[seed, *kind], phase, k) for seed in beds]
                places = i + 0.2 * (j - 0.5 * (len(marks) - 1))
                ax.plot([places] * len(beds), values, "osDd^v<>"[j], color=f"C{j}", ms=4,
                        label=name if i == 0 else None)  # fmt: skip
        ax.set_xticks(range(len(phases)), labels=phases, rotation=30)
        ax.set_yscale("symlog", linthresh=10)
        ax.margins(y=0.08)
        ax.set_title(label, fontsize="medium")
        ax.grid(alpha=0.3)
    axes[0].legend(fontsize="x-small")
    figure.savefig(path, dpi=110)


def figure_of(result, phase, k):
    return result["phases"].get(phase, [0.0] * len(FIGURES))[k]


def judge(runs, seeds, steps):
    """Yields how often halving the window changes a figure by more than the scatter over beds, and whether means differ."""
    phases = runs[seeds[0], "machine", 1]["phases"]
    beds = np.array([[[runs[s, "hermite", n]["phases"][p] for p in phases] for s in seeds] for n in steps[:2]])
    beds = beds.reshape(2, len(seeds), -1)
    beds = beds[:, :, np.abs(beds).max(axis=(0, 1)) > 1.0]
    # A single bed has no scatter.
    if len(seeds) > 1:
        beyond = np.abs(beds[1] - beds[0]) > np.ptp(beds[0], axis=0)
        yield f"{beyond.sum()} of {beyond.size} changes are larger than the range over the beds"
        yield f"smallest p of the means, bed by bed: {stats.ttest_rel(*beds, axis=0).pvalue.min():.2f}"


def table(runs, seeds, steps):
    """Yields lines of Markdown with each figure by phase.

    Columns: mean over the beds for each window length, mean change between the two lengths with its standard error, standard
    deviation over the beds, and the values of the first bed, cubic and held. Figures that are negligible in a phase are
    omitted.
    """
    kinds = [f"cubic, {n}" for n in steps]
    head = ["phase", "figure", *kinds, "halving changes", "standard error", "deviation over beds",
            f"cubic, {steps[0]}, first bed", f"held, {steps[0]}, first bed"]  # fmt: skip
    yield from (f"| {' | '.join(head)} |", "|---" * len(head) + "|")
    phases = runs[seeds[0], "machine", 1]["phases"]
    largest = np.abs([run["phases"][p] for w, run in runs.items() if w[1] == "hermite" for p in phases]).max(axis=0)
    for phase in phases:
        for k, label in enumerate(FIGURES):
            beds = np.array([[figure_of(runs[s, "hermite", n], phase, k) for s in seeds] for n in steps])
            change = beds[1] - beds[0]
            scatter = [np.std(x, ddof=1) if len(seeds) > 1 else np.nan for x in (change, beds[0])]
            held = figure_of(runs[seeds[0], "hold", steps[0]], phase, k)
            row = [*beds.mean(axis=1), change.mean(), scatter[0] / len(seeds) ** 0.5, scatter[1],
                   beds[0, 0], held]  # fmt: skip
            if np.abs(beds).max() > 1e-3 * largest[k]:
                yield f"| {phase} | {label} | {' | '.join(f'{x:.4g}' for x in row)} |"


def main():
    arguments = dict(enumerate(sys.argv))
    case = arguments.get(1, "examples/first.toml")
    folder = Path(arguments.get(2, "runs/windows"))
    steps = [int(n) for n in arguments.get(3, "4,2").split(",")]
    seeds = [int(s) for s in arguments.get(4, "1,2,3").split(",")]
    if len(steps) < 2:
        sys.exit(f"STEPS: expected two lengths of windows or more, such as 4,2; found {steps}")
    kept = runs_folder(case, folder)
    kept.mkdir(parents=True, exist_ok=True)
    wanted = [(seed, "machine", 1) for seed in seeds]
    wanted += [(seed, "hermite", n) for n in steps for seed in seeds] + [(seeds[0], "hold", steps[0])]
    runs = compute(case, kept, wanted, int(arguments.get(5, "1")))
    draw(runs, seeds, steps, folder / "windows.png")
    text = "\n".join(table(runs, seeds, steps))
    (folder / "table.md").write_text(text + "\n")
    print(text, *judge(runs, seeds, steps), folder / "windows.png", sep="\n")


# Worker processes import this file.
if __name__ == "__main__":
    main()

"""Draws the tables of `ballast bench` that are kept in benches/results, as docs/src/developer/performance.md shows them:

    python3 scripts/plot_performance.py [--results benches/results] [--images docs/src/images]

What each plot is drawn from, and the command that measures it, is said in docs/src/developer/performance.md. Needs matplotlib.
"""

import argparse
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scaling_model import model, table

# Rapier 3D tuned for small grains (contact softness 120 Hz, 8 passes) on the same file, on a machine of the same kind:
# steps of 5 ms in 18.6 ms, mean penetration 72 um.
RAPIER = (18.6 / 5.0, 72.0)

Rows = list[dict[str, str]]


def column(rows: Rows, name: str) -> list[float]:
    return [float(row[name]) for row in rows]


def bars(ax: Axes, rows: Rows, group: str, way: str, value: str) -> None:
    """Bars of `value`, those of a `group` side by side, one for each `way`."""
    groups, labels = (list(dict.fromkeys(row[name] for row in rows)) for name in (group, way))
    width = 0.85 / len(labels)
    for k, label in enumerate(labels):
        of = [row for row in rows if row[way] == label]
        x = [groups.index(row[group]) + (k - 0.5 * (len(labels) - 1)) * width for row in of]
        ax.bar(x, column(of, value), width, label=label)
    ax.set_xticks(range(len(groups)), groups, fontsize="small")
    ax.grid(alpha=0.3, axis="y")
    ax.set_axisbelow(True)


def series(rows: Rows, name: str) -> list[Rows]:
    """The rows by their values of `name`, in order."""
    return [[row for row in rows if row[name] == value] for value in dict.fromkeys(row[name] for row in rows)]


def beside(ax: Axes, columns: int = 1) -> None:
    """A legend to the right of the axes."""
    ax.legend(fontsize="small", ncols=columns, loc="center left", bbox_to_anchor=(1.0, 0.5))


def threads(row: dict[str, str]) -> str:
    return "1 thread" if row["threads"] == "1" else f"{row['threads']} threads"


def kernel(results: Path) -> Figure:
    """Visits of the kernel, and the roof above each."""
    _, rows = table(results / "kernel_xeon.csv")
    rows = [row for row in rows if row["instructions"] != "portable"]
    for row in rows:
        alone = row["form"] == "one set per thread"
        contacts = int(row["contacts"]) // (int(row["threads"]) if alone else 1)
        row["set"] = f"{contacts}\nin " + ("one set" if alone else "subdomains")
        row["way"] = f"{row['instructions'].upper().replace('AVX5', 'AVX-5')}, {threads(row)}"
    figure, ax = plt.subplots(figsize=(8.5, 3.6), layout="constrained")
    bars(ax, rows, "set", "way", "mvisits_per_s")
    for drawn, of in zip(ax.containers, series(rows, "way")):
        middles = [bar.get_x() + 0.5 * bar.get_width() for bar in drawn]
        ax.plot(middles, column(of, "roof_mvisits_per_s"), "_", ms=11, mew=2, color=drawn[0].get_facecolor())
    ax.plot([], [], "k_", ms=11, mew=2, label="roof of each")
    beside(ax)
    ax.set(title="Visits of the kernel (Xeon, 2 MiB L2 per core)", xlabel="contacts", ylabel="10⁶ visits per second")
    return figure


def step(results: Path) -> Figure:
    """Phases of a step of the large case, by threads."""
    _, rows = table(results / "step_seven_sleepers.csv")
    figure, ax = plt.subplots(figsize=(8, 2.6), layout="constrained")
    phases = [of for of in series(rows, "phase") if of[0]["phase"] != "whole step"]
    left = [0.0] * len(phases[0])
    for k, of in enumerate(phases):
        times = column(of, "wall_mean_ms")
        ax.barh([threads(row) for row in of], times, left=left, label=of[0]["phase"], color=plt.cm.tab20(k))
        left = [a + b for a, b in zip(left, times)]
    ax.invert_yaxis()
    ax.set(title="A step of seven_sleepers, 100 sweeps", xlabel="wall time, ms")
    beside(ax, columns=2)
    return figure


def subdomains(results: Path) -> Figure:
    """Time, iterations and interface by number of subdomains and schedule, as figures 4 and 5 of the study have them."""
    _, rows = table(results / "subdomains_laptop.csv")
    panels = [
        ("fixed", "step_ms", "a step of 300 iterations, ms"),
        ("fixed", "residual_qm16", "residual of 300 iterations (QM/16)"),
        ("tolerance", "step_ms", "a step to 3e-3, ms"),
        ("fixed", "interface_percent", "contacts of the interface, %"),
    ]
    figure, axes = plt.subplots(1, len(panels), figsize=(11, 3.2), layout="constrained")
    for ax, (rule, value, label) in zip(axes, panels):
        of_rule = [row for row in rows if row["rule"] == rule]
        for of in series(of_rule, "schedule"):
            schedule = of[0]["schedule"]
            if schedule == "sequential":
                ax.axhline(float(of[0][value]), color="k", ls=":", label=schedule)
            else:
                ax.plot(column(of, "subdomains"), column(of, value), "o-", label=schedule)
        ax.set_xscale("log", base=2)
        ax.set_xticks([2, 4, 8, 16, 32, 64], ["2", "4", "8", "16", "32", "64"])
        ax.set_ylim(bottom=0.0)
        ax.set(xlabel="subdomains", title=label)
        ax.title.set_fontsize("small")
        ax.grid(alpha=0.3)
    axes[0].legend(fontsize="small")
    return figure


def iterations(results: Path) -> Figure:
    """What a residual takes from nothing and from the last step, plainly and with what has been added."""
    first = {200: "insertion", 400: "insertion", 600: "squeeze", 800: "squeeze", 1000: "withdrawal"}
    laptop = {125: "lift", 520: "insertion", 1300: "squeeze", 1875: "hold", 2070: "withdrawal"}
    problems = [
        ("first, to 1.666e-4", "iterations_first", first),
        ("laptop, to 1.666e-4", "iterations_laptop_equal", laptop),
    ]
    figure, axes = plt.subplots(1, len(problems), figsize=(11.5, 3.6), layout="constrained")
    for ax, (title, name, phases) in zip(axes, problems):
        rows: Rows = []
        for number, phase in phases.items():
            _, of_step = table(results / f"{name}_{number}.csv")
            for row in of_step:
                row["step"] = f"{number}\n{phase}"
                way = "subdomains, from the last step" if row["way"].startswith("synchronous") else row["way"]
                row["way"] = way.replace(";", ",") + (f", {threads(row)}" if row["threads"] != "1" else "")
            rows += of_step
        bars(ax, rows, "step", "way", "solve_ms")
        ax.set_yscale("log")
        ax.set(title=title, xlabel="step", ylabel="solving a step, ms (median)")
    beside(axes[-1])
    return figure


def scaling(results: Path) -> Figure:
    """The model of how far threads help."""
    modelled, _ = model(results, 200.0)
    figure, (times, efficiency) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
    for grains in dict.fromkeys(row.grains for row in modelled):
        of = [row for row in modelled if row.grains == grains]
        x = [row.threads for row in of]
        times.loglog(x, [row.whole for row in of], "o-", label=f"{grains} grains")
        efficiency.semilogx(x, [100 * row.efficiency for row in of], "o-")
    _, rows = table(results / "step_seven_sleepers.csv")
    whole = [row for row in rows if row["phase"] == "whole step"]
    x, measured = column(whole, "threads"), [1e-3 * ms for ms in column(whole, "wall_mean_ms")]
    times.loglog(x, measured, "kx", label="measured")
    efficiency.semilogx(x, [100.0 * measured[0] / (n * t) for n, t in zip(x, measured)], "kx")
    for ax in (times, efficiency):
        ax.set_xticks([1, 4, 16, 64, 256], ["1", "4", "16", "64", "256"])
        ax.minorticks_off()
        ax.set_xlabel("threads")
        ax.grid(alpha=0.3)
    times.set_ylabel("a step of 100 sweeps, s")
    times.legend(fontsize="small")
    efficiency.set_ylabel("efficiency, %")
    efficiency.set_ylim(bottom=0.0)
    figure.suptitle("Lines: a model, not a measurement", fontsize="medium")
    return figure


def cost(results: Path) -> Figure:
    """What a simulated second costs over the penetration that is left."""
    _, rows = table(results / "cost_settled2000.csv")
    figure, ax = plt.subplots(figsize=(6.5, 4.2), layout="constrained")
    lines = dict.fromkeys((row["step_ms"], row["recovery"]) for row in rows)
    colours = {step: f"C{i}" for i, step in enumerate(dict.fromkeys(step for step, _ in lines))}
    for length, share in lines:
        line = [row for row in rows if (row["step_ms"], row["recovery"]) == (length, share)]
        taken_back = float(share) > 0.0
        x, y = column(line, "cpu_s_per_simulated_s"), column(line, "mean_penetration_um")
        label = f"Ballast, steps of {float(length):g} ms" + (", recovery" if taken_back else "")
        ax.loglog(x, y, "o--" if taken_back else "o-", color=colours[length], label=label)
        for row, at in zip(line, zip(x, y)):
            ax.annotate(row["iterations"], at, xytext=(4, 4), textcoords="offset points", fontsize="x-small")
    ax.loglog(*RAPIER, "k*", ms=11, label="Rapier, steps of 5 ms, 8 passes")
    ax.set(
        title="2000 stones at rest; numbers are iterations per step",
        xlabel="CPU time per simulated second, s",
        ylabel="mean penetration, µm",
    )
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter("{x:g}")
    ax.grid(alpha=0.3, which="both")
    ax.legend(fontsize="small")
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--results", type=Path, default=Path("benches/results"))
    parser.add_argument("--images", type=Path, default=Path("docs/src/images"))
    args = parser.parse_args()
    for draw in (cost, kernel, step, subdomains, iterations, scaling):
        path = args.images / f"{draw.__name__}.png"
        figure = draw(args.results)
        figure.savefig(path, dpi=110)
        plt.close(figure)
        print(path)


if __name__ == "__main__":
    main()

"""Compares coupling schemes and window lengths over a few milliseconds of a cycle: error and cost.

    python examples/machine/tamp.py --out runs/part --windows 500
    python examples/machine/schemes.py runs/part --steps 32

Every scheme starts from the checkpoint of the run. The reference is the implicit scheme with windows of one step and a
tolerance of 1e-8 m. Written are `schemes.md` and `schemes.png` in the same folder.
"""

import argparse
import pickle
import time
from pathlib import Path

import ballast
import numpy as np
import tamp
from ballast import couple

HERE = Path(__file__).parent


def stretch(sim, start, checkpoint, args, scheme, steps, acceleration="iqn-ils", tolerance=2e-6):
    """Returns ways of the blades at common times, energy lost at the interface, iterations and wall time."""
    chosen = {"scheme": scheme, "acceleration": acceleration, "window": steps, "tolerance": tolerance, "max_iterations": 20}
    options = argparse.Namespace(**args.run | chosen)
    # The unit begins where its case does.
    sim.restore(start)
    coupling, unit = tamp.couple_unit(sim, sim.case, options)
    coupling.restore(checkpoint)
    ways, windows, began = [], [], time.perf_counter()
    for k in range(args.steps // steps):
        windows.append(coupling.advance())
        if (k + 1) * steps % args.common == 0:
            ways.append([windows[-1].result[name].position for name in unit.names])
    wall = time.perf_counter() - began
    given = sum(abs(w.work_given) for w in windows)
    lost = sum(abs(w.energy_residual) for w in windows)
    iterations = np.array([w.iterations for w in windows])
    return {"ways": np.array(ways), "lost": lost / given, "iterations": iterations, "wall": wall,
            "converged": all(w.is_converged for w in windows), "solved": int(iterations.sum()) * steps}  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description="Compare coupling schemes and window lengths")
    parser.add_argument("folder", type=Path, help="folder of a run of tamp.py")
    parser.add_argument("--case", default=HERE / "tamping.toml", help="case file of the run")
    parser.add_argument("--steps", type=int, default=32, help="time steps of the stretch")
    parser.add_argument("--common", type=int, default=8, help="longest window, time steps; it divides the stretch")
    args = parser.parse_args()
    args.run, (checkpoint, _) = pickle.loads((args.folder / "checkpoint.pickle").read_bytes())
    lengths = [n for n in (8, 4, 2, 1) if n <= args.common]
    head = ["scheme", "steps of a window", "error of the blades, mm", "energy lost, % of the work",
            "iterations, median and largest", "time steps solved", "wall time, s"]  # fmt: skip
    rows = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    results = {}
    with ballast.open(args.case) as sim:
        start = sim.save()
        reference = stretch(sim, start, checkpoint, args, "implicit", 1, tolerance=1e-8)
        kinds = [("parallel", ""), ("staggered", ""), *(("implicit", name) for name in couple.ACCELERATIONS)]
        for scheme, acceleration in kinds:
            for steps in lengths:
                label = f"{scheme} {acceleration}".strip()
                try:
                    run = stretch(sim, start, checkpoint, args, scheme, steps, acceleration or "fixed")
                except couple.CouplingError as failure:
                    rows.append(f"| {label} | {steps} | failed: {failure.result.code} | | | | |")
                    continue
                error = float(np.linalg.norm(run["ways"] - reference["ways"], axis=2).max())
                results.setdefault(label, []).append((run["solved"], error, run["lost"]))
                counts = run["iterations"]
                mark = "" if run["converged"] else ", not converged in all windows"
                rows.append(f"| {label} | {steps} | {error * 1e3:.3g} | {run['lost'] * 100:.2g} | {np.median(counts):.0f}, "
                            f"{counts.max()}{mark} | {run['solved']} | {run['wall']:.1f} |")  # fmt: skip
    text = "\n".join(rows)
    (args.folder / "schemes.md").write_text(text + "\n")
    draw(results, args.folder / "schemes.png")
    print(text, f"\n{args.folder / 'schemes.png'}")


def draw(results, path):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    for label, points in results.items():
        solved, error, lost = np.array(points).T
        axes[0].loglog(solved, error * 1e3, "o-", label=label)
        axes[1].loglog(solved, lost * 100, "o-", label=label)
    for ax, title in zip(axes, ("error of the blades, mm", "energy lost at the interface, % of the work"), strict=True):
        ax.set(title=title, xlabel="time steps solved")
        ax.grid(alpha=0.3, which="both")
    axes[0].legend(fontsize="small")
    figure.savefig(path, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    main()

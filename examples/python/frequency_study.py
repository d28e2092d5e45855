"""How the frequency of the vibration changes tamping: a study, its table, its plot.

    python examples/python/frequency_study.py [CASE [FOLDER [FREQUENCIES [SEEDS]]]]
    python examples/python/frequency_study.py examples/laptop.toml runs/frequency 20,25,30,35,40,45,50 1,2,3

Stopped, it goes on where it was; a whole cycle of `laptop` takes some five minutes on one core.
"""

import sys

import matplotlib

from ballast import study

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def main():
    arguments = dict(enumerate(sys.argv))
    case = arguments.get(1, "examples/first.toml")
    folder = arguments.get(2, "runs/frequency")
    frequencies = [float(f) for f in arguments.get(3, "20,25,30,35,40,45,50").split(",")]
    seeds = [int(s) for s in arguments.get(4, "1").split(",")]
    axis = "tamping.vibration.frequency_Hz"
    points = study.grid({axis: frequencies, "seed": seeds})
    table = study.run(case, points, folder)
    table.to_csv(f"{folder}/table.csv", index=False)
    for text in table["error"].dropna():
        print("failed:", text)
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
    under = [c for c in table if c.startswith("under/") and c.endswith("after")]
    for name in under:
        gain = table[name] - table[name.replace("after", "before")]
        axes[0].plot(table[axis], 100 * gain, "o", label=name.removesuffix(": after"))
    axes[0].set(ylabel="gain of compactness, percentage points")
    for name in (c for c in table if c.endswith("mean force N")):
        axes[1].plot(table[axis], table[name] * 1e-3, "o", label=name.split(":")[0])
    axes[1].set(ylabel="mean force in the squeeze, kN")
    # Of points that have all failed there are no figures.
    if "compaction_per_kJ" in table:
        axes[2].plot(table[axis], table["compaction_per_kJ"], "o")
    axes[2].set(ylabel="gain of compactness per kJ")
    for ax in axes:
        ax.set_xlabel("frequency, Hz")
        ax.grid(alpha=0.3)
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize="small")
    figure.savefig(f"{folder}/frequency.png", dpi=110)
    print(table.to_string())
    print(f"{folder}/frequency.png")


# Studies run in processes of their own, which read this file again.
if __name__ == "__main__":
    main()

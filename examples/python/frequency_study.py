"""Studies how the vibration frequency changes tamping: runs the points, writes a table and a plot.

    python examples/python/frequency_study.py [CASE [FOLDER [FREQUENCIES [SEEDS]]]]
    python examples/python/frequency_study.py benches/cases/laptop_rigid.toml runs/frequency 20,25,30,35,40,45,50 1,2,3

A stopped study continues where it was. A cycle of `laptop_rigid` takes about five minutes on one core.
"""

import sys

import matplotlib

from ballast import study

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

AXIS = "tamping.vibration.frequency_Hz"

arguments = dict(enumerate(sys.argv))
case = arguments.get(1, "examples/first.toml")
folder = arguments.get(2, "runs/frequency")
frequencies = [float(f) for f in arguments.get(3, "20,25,30,35,40,45,50").split(",")]
seeds = [int(s) for s in arguments.get(4, "1").split(",")]

table = study.run(case, study.grid({AXIS: frequencies, "seed": seeds}), folder)
table.to_csv(f"{folder}/table.csv", index=False)
for error in table["error"].dropna():
    print("failed:", error)

figure, axes = plt.subplots(1, 3, figsize=(12, 3.6), layout="constrained")
for column in (c for c in table if c.startswith("under/") and c.endswith(": final compactness")):
    zone = column.split(":")[0]
    gain = table[column] - table[f"{zone}: initial compactness"]
    axes[0].plot(table[AXIS], 100 * gain, "o", label=zone)
axes[0].set(ylabel="gain of compactness, percentage points")
for column in (c for c in table if c.endswith(": mean force N")):
    axes[1].plot(table[AXIS], table[column] * 1e-3, "o", label=column.split(":")[0])
axes[1].set(ylabel="mean force in the squeeze, kN")
# The column is missing if all points failed.
if "compaction per kJ" in table:
    axes[2].plot(table[AXIS], table["compaction per kJ"], "o")
axes[2].set(ylabel="gain of compactness per kJ")
for ax in axes:
    ax.set_xlabel("frequency, Hz")
    ax.grid(alpha=0.3)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize="small")
figure.savefig(f"{folder}/frequency.png", dpi=110)
print(table.to_string())
print(f"{folder}/frequency.png")

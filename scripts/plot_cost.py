"""Draws what a simulated second costs over the penetration that is left, from the table of `ballast bench cost`:

    ballast bench cost settled2000.json --threads 1 --csv benches/results/cost_settled2000.csv
    python3 scripts/plot_cost.py benches/results/cost_settled2000.csv docs/images/cost.png
"""

import csv
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# Rapier 3D tuned for small grains (contact softness 120 Hz, 8 passes) on the same file, on a machine of the same kind:
# steps of 5 ms in 18.6 ms, mean penetration 72 um.
RAPIER = (18.6 / 5.0, 72.0)

with open(sys.argv[1]) as file:
    rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
if not rows:
    sys.exit(f"{sys.argv[1]}: no rows")
figure, ax = plt.subplots(figsize=(6.5, 4.2), layout="constrained")
lines = dict.fromkeys((row["step_ms"], row["recovery"]) for row in rows)
colours = {step: f"C{i}" for i, step in enumerate(dict.fromkeys(step for step, _ in lines))}
for step, share in lines:
    line = [row for row in rows if (row["step_ms"], row["recovery"]) == (step, share)]
    taken_back = float(share) > 0.0
    x = [float(row["cpu_s_per_simulated_s"]) for row in line]
    y = [float(row["mean_penetration_um"]) for row in line]
    label = f"Ballast, steps of {float(step):g} ms" + (", recovery" if taken_back else "")
    ax.loglog(x, y, "o--" if taken_back else "o-", color=colours[step], label=label)
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
figure.savefig(sys.argv[2], dpi=110)
print(sys.argv[2])

"""Plots compactness, coordination, penetration and forces of a run of seven sleepers over time.

    python3 scripts/plot_seven_sleepers.py runs/seven_sleepers_compliant docs/src/images/seven_sleepers.png
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from ballast import tables

PERIOD = 36  # steps of a vibration period


def main(run, picture):
    steps, zones = (tables.to_pandas(run, name) for name in ("steps", "zones"))
    begins = steps.index[steps["phase"] != steps["phase"].shift()]
    figure, axes = plt.subplots(3, 2, figsize=(13, 11), layout="constrained")
    under, cribs, coordination, penetration, tines, sleepers = axes.flat
    for k in range(1, 8):
        style = {"lw": 2.5, "color": "k"} if k == 4 else {"lw": 1.2, "color": f"C{k}"}
        under.plot(zones[f"under/sleeper_{k}"], label=f"sleeper {k}", **style)
        sleepers.plot(period_mean_force(steps, f"sleeper_{k}"), label=f"sleeper {k}", **style)
        name = f"{k} and {k + 1}" if k < 7 else "7 and wall"
        cribs.plot(zones[f"crib_plus_x/sleeper_{k}"], label=name, lw=2 if k in (3, 4) else 1)
    cribs.plot(zones["crib_minus_x/sleeper_1"], "--", label="wall and 1")
    under.plot(zones["under_lifted/sleeper_4"], "k--", label="sleeper 4, lifted level")
    coordination.plot(steps["coordination"])
    for name in ("max_penetration", "mean_penetration"):
        penetration.semilogy(1e3 * steps[name], label=name.split("_")[0], lw=0.7)
    for name in sorted(name.removesuffix("_force_x") for name in steps if name.startswith("tine_") and name.endswith("_force_x")):
        tines.plot(period_mean_force(steps, name), label=name)
    for ax, title, unit in (
        (under, "compactness under the sleepers", ""), (cribs, "compactness of the cribs", ""),
        (coordination, "touching neighbours of a stone, whole bed", ""), (penetration, "penetration", "mm"),
        (tines, "force on the tines, means over a vibration period", "kN"),
        (sleepers, "force on the sleepers, means over a vibration period", "kN"),
    ):  # fmt: skip
        ax.set(title=title, xlabel="time, s", ylabel=unit)
        ax.grid(alpha=0.3)
        for begin in begins:
            ax.axvline(begin, color="grey", lw=0.5)
        if ax is not coordination:
            ax.legend(fontsize="x-small", ncols=2)
    figure.savefig(picture, dpi=90)


def period_mean_force(steps, name):
    """Returns the magnitude of the mean force over a period, kN."""
    mean = [steps[f"{name}_force_{axis}"].rolling(PERIOD, center=True, min_periods=1).mean() for axis in "xyz"]
    return 1e-3 * np.sqrt(sum(part**2 for part in mean))


if __name__ == "__main__":
    main(*sys.argv[1:])

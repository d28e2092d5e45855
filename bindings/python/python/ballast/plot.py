"""Plots of results with matplotlib.

Functions accept `Results`, the path of a results file, or the folder of a run. They draw into `ax` or a new figure.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

import ballast
from ballast import _ballast

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Run = ballast.Results | str | os.PathLike[str]

#: Number of the squeeze phase in the table "steps".
SQUEEZE_PHASE = 3


def _results(run: Run) -> ballast.Results:
    return run if isinstance(run, ballast.Results) else ballast.Results(ballast._run_file(run, "results.vtkhdf"))


def _axes(ax: Axes | None, title: str, x: str, y: str) -> Axes:
    if ax is None:
        import matplotlib.pyplot as plt

        _, ax = plt.subplots(layout="constrained")
    ax.set(title=title, xlabel=x, ylabel=y)
    ax.grid(alpha=0.3)
    return ax


def _legend(ax: Axes) -> None:
    """Adds a legend, unless the axes are empty: matplotlib would warn."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(fontsize="small", framealpha=0.5)


def tines(run: Run) -> list[str]:
    """Returns the names of the tines in a results file."""
    results = _results(run)
    return [name for name, role in results.roles.items() if role == "tine"]


def _directions(results: ballast.Results) -> dict[str, float]:
    """Direction of each tine's squeeze along x, 1 or -1, from the case: vibration or jamming may reverse a blade's motion."""
    single = _ballast._parse_toml(results.case_text).get("tine", [])
    directions = {tine["name"]: tine["squeeze_direction"] for tine in single}
    # Tines of rows have the direction in their name.
    plus = [name for name in tines(results) if directions.get(name, name).endswith(("+x", "_plus"))]
    return {name: 1.0 if name in plus else -1.0 for name in tines(results)}


def compactness(run: Run, ax: Axes | None = None) -> Axes:
    """Plots the compactness of each zone over time; returns the axes."""
    table = _results(run).table("zones")
    ax = _axes(ax, "Compactness", "time, s", "solid over accessible volume")
    zones = [name for name in table if name not in ("step", "time")]
    for name in zones:
        ax.plot(table["time"], table[name], label=name)
    if not zones:
        ax.text(0.5, 0.5, "no zones: no sleeper is tamped", ha="center", va="center", transform=ax.transAxes)
    _legend(ax)
    return ax


def forces(run: Run, ax: Axes | None = None, *, window_s: float = 0.004) -> Axes:
    """Plots the magnitude of the force on each tine over time; returns the axes.

    Args:
        run: results, their path, or the folder of a run.
        ax: axes to draw into; default: a new figure.
        window_s: length of the moving average, s, rounded to whole steps, at least one.
    """
    results = _results(run)
    table = results.table("steps")
    n, over = _window(table["time"], window_s)
    ax = _axes(ax, "Forces on the tines", "time, s", f"force, {over}, kN")
    for name in tines(results):
        force = _mean(_force(table, name), n)
        ax.plot(table["time"], np.linalg.norm(force, axis=1) * 1e-3, lw=0.8, label=name)
    _legend(ax)
    return ax


def loops(run: Run, ax: Axes | None = None, *, window_s: float = 0.004) -> Axes:
    """Plots the force over the closing of each tine in the squeeze; returns the axes. The area of a loop is work.

    Only runs with a tamping cycle have phases, and so loops; `WindowResult.squeezes` has the squeezes of other runs.

    Args:
        run: results, their path, or the folder of a run.
        ax: axes to draw into; default: a new figure.
        window_s: length of the moving average, s, rounded to whole steps, at least one.
    """
    results = _results(run)
    table = results.table("steps")
    n, over = _window(table["time"], window_s)
    ax = _axes(ax, "Squeeze", "closing, mm", f"force against the motion, {over}, kN")
    squeeze = table["phase"] == SQUEEZE_PHASE
    if not squeeze.any():
        ax.text(0.5, 0.5, "no step in the squeeze phase", ha="center", va="center", transform=ax.transAxes)
    for name, inwards in _directions(results).items() if squeeze.any() else ():
        x = table[f"{name}_x"][squeeze]
        # Vibration may move a tine back behind its start.
        closing = inwards * (x - x[0])
        against = -inwards * _mean(_force(table, name), n)[squeeze, 0]
        ax.plot(closing * 1e3, against * 1e-3, lw=0.8, label=name)
    _legend(ax)
    return ax


def overview(run: Run) -> Any:
    """Plots compactness, forces, loops and penetration; returns the figure."""
    import matplotlib.pyplot as plt

    results = _results(run)
    table = results.table("steps")
    figure, ax = plt.subplots(2, 2, figsize=(11, 7.5), layout="constrained")
    figure.suptitle(results.case_name)
    compactness(results, ax[0, 0])
    forces(results, ax[0, 1])
    loops(results, ax[1, 0])
    last = _axes(ax[1, 1], "Penetration", "time, s", "penetration, mm")
    for name, label in (("max_penetration", "largest"), ("mean_penetration", "mean")):
        last.semilogy(table["time"], np.maximum(table[name], 1e-9) * 1e3, lw=0.8, label=label)
    last.legend(fontsize="small")
    return figure


def _force(table: dict[str, Any], body: str) -> Any:
    return np.stack([table[f"{body}_force_{axis}"] for axis in "xyz"], axis=1)


def _window(time: Any, window_s: float) -> tuple[int, str]:
    """Returns the number of steps of a moving average, and its description."""
    if not window_s > 0.0:
        raise ValueError(f"window_s: expected a number above 0, found {window_s}")
    if len(time) < 2:
        return 1, "of a step"
    step = float(time[1] - time[0])
    n = max(1, round(min(window_s / step, len(time))))
    return n, f"mean over {n * step * 1e3:.4g} ms"


def _mean(values: Any, n: int) -> Any:
    """Returns the moving average over the last `n` rows."""
    sums = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), values]), axis=0)
    ends = np.arange(1, len(values) + 1)
    begins = np.maximum(ends - n, 0)
    return (sums[ends] - sums[begins]) / (ends - begins)[:, None]

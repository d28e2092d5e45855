"""Parameter studies over cases: many runs, side by side, resumable, one table at the end.

    from ballast import study

    if __name__ == "__main__":
        points = study.grid({"tamping.vibration.frequency_Hz": [20, 30, 40], "seed": [1, 2]})
        table = study.run("examples/first.toml", points, "runs/study")

Points are run by processes of their own, which read the script again: without the first line they would begin
the study once more. A point is a dictionary: paths of the case's keys joined by points, and "seed" for that of the bed. Needs
pandas; Latin hypercubes need scipy, schedulers dask.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import numbers
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

import ballast
from ballast import _ballast, _identity, _workers
from ballast._json import dumps, strict
from ballast._progress import show

if TYPE_CHECKING:
    import pandas as pd

Point = Mapping[str, Any]
#: None where there is nothing to tell.
Figures = Mapping[str, float | None]
Measure = Callable[[ballast.Case, str], Figures]


class Executor(Protocol):
    """What runs the points: of `concurrent.futures`, or a `dask.distributed.Client`."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any: ...


def grid(axes: Mapping[str, Iterable[Any]]) -> list[dict[str, Any]]:
    """All combinations of the values of each axis."""
    if not isinstance(axes, Mapping):
        raise TypeError(f"axes: expected a dictionary from paths of keys to lists of values, found {axes!r}")
    lists = [_listed(f"axis {name!r}", "a list of values", values) for name, values in axes.items()]
    for name, values in zip(axes, lists, strict=True):
        if not values:
            raise ValueError(f"axis {name!r}: expected one value or more, found none")
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*lists)]


def _listed(place: str, expected: str, values: Any) -> list[Any]:
    """A list of what is to be one: letters of a text and keys of a dictionary are not meant."""
    try:
        if not isinstance(values, str | bytes | Mapping):
            return list(iter(values))
    except TypeError:
        pass
    raise TypeError(f"{place}: expected {expected}, found {values!r}")


def _points(points: Any) -> list[Point]:
    listed = _listed("points", "a list of points, as of study.grid", points)
    for i, point in enumerate(listed):
        _check_point(f"points[{i}]", point)
    return listed


def _check_point(place: str, point: object) -> None:
    if not isinstance(point, Mapping):
        raise TypeError(f"{place}: expected a dictionary from paths of keys to values, found {point!r}")


def latin_hypercube(
    ranges: Mapping[str, tuple[float, float]],
    n: int,
    *,
    seed: int = 0,
    integers: Collection[str] = (),
) -> list[dict[str, float]]:
    """`n` points that fill the ranges evenly: each axis has one point in each `n`-th of it.

    `integers` names the axes that take whole numbers, both ends of their range among them, such as "seed".
    """
    from scipy.stats import qmc

    if not isinstance(ranges, Mapping):
        raise TypeError(f"ranges: expected a dictionary from paths of keys to (lowest, highest), found {ranges!r}")
    if not isinstance(n, numbers.Integral) or n < 0:
        raise ValueError(f"n: expected a whole number from 0 on, found {n!r}")
    integers = _listed("integers", "a list of names of axes", integers)
    unknown = set(integers) - set(ranges)
    if unknown:
        raise ValueError(f"integers: expected some of {list(ranges)}, found {sorted(unknown)}")
    for name, ends in ranges.items():
        try:
            low, high = ends
            is_range = math.isfinite(low) and math.isfinite(high) and low <= high
        except (TypeError, ValueError):
            is_range = False
        if not is_range:
            raise ValueError(f"range of {name!r}: expected (lowest, highest), found {ends!r}")
        if name in integers and not (float(low).is_integer() and float(high).is_integer()):
            raise ValueError(f"range of {name!r}, a whole number: expected whole ends, found ({low}, {high})")

    def value(name: str, share: float) -> float:
        low, high = ranges[name]
        if name in integers:
            return min(math.floor(low + share * (high + 1 - low)), int(high))
        return low + share * (high - low)

    sample = qmc.LatinHypercube(len(ranges), rng=seed).random(n)
    return [
        {name: value(name, float(share)) for name, share in zip(ranges, row, strict=True)}
        for row in sample
    ]


def apply(case: ballast.Case, point: Point) -> ballast.Case:
    """The case of a point."""
    _check_point("point", point)
    values = {key: value for key, value in _with_one_seed(point).items() if key != "seed"}
    changed = case.with_values(values) if values else case
    return changed.choose(seed=point.get("seed"))


def _with_one_seed(point: Point) -> Point:
    """A point that says the bed's seed by one of its two names at most."""
    if "seed" in point and "bed.seed" in point:
        found = f"{point['seed']} and {point['bed.seed']}"
        error = ballast.CaseError(f"expected one seed of the bed, as seed or bed.seed, found {found}")
        error.code = "case"
        raise error
    return point


@contextlib.contextmanager
def _naming(point: Point) -> Iterator[None]:
    """What is wrong with a point is told with it."""
    try:
        yield
    except (ballast.Error, TypeError, ValueError) as error:
        error.args = (f"point {dict(point)}: {error}", *error.args[1:])
        raise


def _applied(case: ballast.Case, point: Point) -> ballast.Case:
    with _naming(point):
        return apply(case, point)


def run_tamping_cycle(case: ballast.Case, beds: str) -> Figures:
    """One whole cycle of the case's machine on one thread, in figures:

    compactness of each zone before and after, the mean and the largest size of the force on each tine in the squeeze (N;
    moving means over 4 ms), the work of all tines (J), the largest penetration (m), the share of steps that
    stopped at their cap of iterations before they reached the tolerance (where the case asks for one), and
    `compaction_per_kJ`: what the zones under sleepers have gained in the mean, per kJ of work.
    """
    has_tolerance = case.to_dict().get("solver", {}).get("tolerance") != 0
    with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
        tines = [tine.name for tine in sim.tines]
        before = {name: zone.compactness for name, zone in sim.zones().items()}
        squeezed: dict[str, list[float]] = {name: [] for name in tines}
        work = capped = deepest = 0.0
        steps = case.duration_ns // case.step_ns
        for _ in range(steps):
            phase = sim.phase
            out = sim.step_tamping_cycle()
            if out.status not in ("ok", "warn"):
                raise ballast.Error(f"{out!r}: {out.error_message}")
            work += sum(out[name].work for name in tines)
            capped += out.solver.steps_not_converged
            deepest = max(deepest, out.solver.max_penetration)
            if phase == "squeeze":
                for name in tines:
                    force = out[name].moving_average_force
                    squeezed[name].append(float((force @ force) ** 0.5))
        after = {name: zone.compactness for name, zone in sim.zones().items()}
    figures: dict[str, float] = {}
    gains = []
    for name, start in before.items():
        end = after[name]
        if start is None or end is None:
            continue
        figures[f"{name}: before"], figures[f"{name}: after"] = start, end
        if name.startswith("under/"):
            gains.append(end - start)
    for name, forces in squeezed.items():
        if forces:
            figures[f"{name}: mean force N"] = sum(forces) / len(forces)
            figures[f"{name}: largest force N"] = max(forces)
    figures["work J"] = work
    figures["largest penetration m"] = deepest
    if has_tolerance:
        figures["steps at the cap"] = capped / max(steps, 1)
    if gains and work > 0.0:
        figures["compaction_per_kJ"] = sum(gains) / len(gains) / (work * 1e-3)
    return figures


def run(
    case: ballast.Case | str | os.PathLike[str],
    points: Iterable[Point],
    folder: str | os.PathLike[str],
    *,
    measure: Measure = run_tamping_cycle,
    jobs: int | None = None,
    executor: Executor | None = None,
    bed_cache: str | os.PathLike[str] = ballast.DEFAULT_BED_CACHE,
    progress: bool = True,
) -> pd.DataFrame:
    """Runs every point that the folder does not hold yet, and returns the table of all.

    Each point that is done is a file of the folder, so a study that was stopped goes on where it was, also with more
    points or from another process. A point is run again where its case, its values, the measure, the version of the
    package or the key of its bed is another one. A build that computes otherwise on the same beds is not noticed: it
    needs a folder of its own. A point that fails is told at once, and in the column `error`; the next call tries it
    again. Points that make no case (CaseError) are told before anything is run. Where a process is killed (for its
    memory, say), the points at hand are run again one by one, and only one that is killed again fails.

    Args:
        case: the case that points change.
        points: see `grid` and `latin_hypercube`.
        folder: of this study.
        measure: a function from a case and a folder of beds to figures, of a module or of the script (processes must find
            it, unless `executor` does), or `functools.partial` of one. With other code, or other values bound to it or
            taken from around it, all points are run again; what it calls, and what its module holds, is not looked at.
            Code is what it was compiled to, not what its file says by now: another Python runs its points again. Where the
            measure that a process has read is another one than here, its points fail.
        jobs: processes; by default one per processor. RequestError beside `executor`.
        executor: what runs the points instead of processes of this machine, such as a `dask` client.
        bed_cache: folder of prepared beds.
        progress: a line per point on stderr.
    """
    if jobs is not None and not (isinstance(jobs, numbers.Integral) and jobs > 0):
        raise ValueError(f"jobs: expected a whole number from 1 on, found {jobs!r}")
    if jobs is not None and executor is not None:
        raise TypeError("run: jobs: expected none beside executor, which has its own")
    base = case if isinstance(case, ballast.Case) else ballast.Case.load(case)
    points = _points(points)
    cases = [_applied(base, point) for point in points]
    store = Path(folder)
    store.mkdir(parents=True, exist_ok=True)
    keys = [_identity.key(base, case.bed_key, point, measure) for case, point in zip(cases, points, strict=True)]
    files = [store / f"{key}.json" for key in keys]
    for file in filter(Path.exists, files):
        _kept(file)
    # Points that ask for the same share a file.
    first = {file: i for i, file in reversed([*enumerate(files)])}
    missing = sorted(i for file, i in first.items() if not file.exists())
    errors: dict[Path, str] = {}

    def say(what: str) -> None:
        if progress:
            show(f"study: {what}")

    def fail(i: int, error: str) -> None:
        errors[files[i]] = error
        say(f"{dict(points[i])} failed: {error}")

    def keep(i: int, figures: str) -> None:
        # For readers; the name of the file holds what counts.
        of = {"case": cases[i].name, "seed": cases[i].seed, "bed": cases[i].bed_key}
        by = {"measure": _identity.name(measure), "version": ballast.__version__}
        told = {**of, **by, "point": dict(points[i]), "figures": json.loads(figures)}
        _ballast._replace_file(files[i], dumps(strict(told), indent=1))
        say(f"{dict(points[i])} done, {sum(not file.exists() for file in first)} to go")

    def every(calls: dict[int, _workers.Call], keep: _workers.Keep) -> None:
        if executor is None:
            _workers.by_processes(calls, jobs, keep, fail)
        else:
            _workers.wait_for({i: executor.submit(_workers.tried, *call) for i, call in calls.items()}, keep, fail)

    if missing and executor is None:
        _workers.check(measure)
    # Beds first, each once: points that share one would all prepare it.
    shared = {cases[i].bed_key: i for i in missing}
    every({i: (_bed, cases[i], str(bed_cache)) for i in shared.values()}, lambda i, bed: None)
    for i in missing:
        without_bed = errors.get(files[shared[cases[i].bed_key]])
        if without_bed is not None and files[i] not in errors:
            fail(i, without_bed)
    named = {i: tuple(points[i]) for i in missing if files[i] not in errors}
    code = _identity.code(measure)
    every({i: (_point, cases[i], str(bed_cache), measure, code, names) for i, names in named.items()}, keep)
    return _table(points, files, errors)


def write_sweep_plan(
    case: str | os.PathLike[str], points: Iterable[Point], path: str | os.PathLike[str]
) -> None:
    """Writes points as a plan of `ballast sweep`, which runs them without Python: on this machine with `--jobs`, or one
    each in the array jobs of a scheduler with `--case NUMBER`. `case` is a path, relative to the plan. Of what lies at
    `path` only another plan is replaced. Raises FileError."""
    named = []
    for point in _points(points):
        with _naming(point):
            values = _with_one_seed(point).items()
        named.append({"bed.seed" if key == "seed" else key: value for key, value in values})
    _ballast._write_sweep_plan(os.fspath(case), named, path)


def _bed(case: ballast.Case, beds: str) -> None:
    ballast.prepare(case, bed_cache=beds, threads=1, progress=False)


def _point(case: ballast.Case, beds: str, measure: Measure, code: str, names: Collection[str]) -> str:
    """Figures of a point whose values have these names, as JSON: they may be of types that no other process knows. `code` is
    what the measure was where the study was begun."""
    if _identity.code(measure) != code:
        raise ballast.Error(
            f"measure: expected {_identity.name(measure)} as the study was begun with, found another one of this name: its "
            "file was changed after one of the two processes had read it, or they run two versions of Python; begin both anew"
        )
    figures = measure(case, beds)
    _check_figures(names, figures)
    return dumps(dict(figures))


def _check_figures(names: Collection[str], figures: object) -> None:
    expected = "measure: expected a dictionary from names to numbers"
    if not isinstance(figures, Mapping):
        raise TypeError(f"{expected}, found {figures!r}")
    for name, value in figures.items():
        if not isinstance(name, str) or not isinstance(value, numbers.Real | np.bool_ | None):
            raise TypeError(f"{expected}, found {name!r}: {value!r}")
        if name in names or name == "error":
            raise ValueError(f"measure: expected other names than those of the point and 'error', found {name!r}")


def _kept(file: Path) -> Figures:
    """The figures of a point that is done."""
    try:
        figures = json.loads(file.read_text())["figures"]
        if isinstance(figures, dict):
            return {name: float(value) if isinstance(value, str) else value for name, value in figures.items()}
    except (ValueError, KeyError, TypeError):
        pass
    text = f"{file}: expected the figures of a point (JSON), found something else; without the file the point is run again"
    error = ballast.FileError(text)
    error.code = "file"
    raise error


def _table(points: Sequence[Point], files: Sequence[Path], errors: Mapping[Path, str]) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for point, file in zip(points, files, strict=True):
        figures = _kept(file) if file.exists() else {}
        rows.append({**point, **figures, "error": errors.get(file)})
    return pd.DataFrame(rows, columns=None if rows else ["error"])

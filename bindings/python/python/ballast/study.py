"""Parameter studies: many runs of a case in parallel, resumable, with one table as the result.

    from ballast import study

    points = study.grid({"tamping.vibration.frequency_Hz": [20, 30, 40], "seed": [1, 2]})
    table = study.run("examples/first.toml", points, "runs/study")

A point is a dictionary from dotted key paths of the case to values; "seed" is the seed of the bed. `run` needs pandas and
loky, Latin hypercubes need scipy: `pip install 'ballast[study]'`.
"""

from __future__ import annotations

import contextlib
import importlib
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
from ballast import _ballast, _identity, _pool
from ballast._json import dumps, with_text_for_nonfinite
from ballast._progress import show
from ballast._zones import is_under, tamped_sleepers

if TYPE_CHECKING:
    import pandas as pd

#: Values by dotted key path, and "seed".
Point = Mapping[str, Any]
#: Results of a point by name; None for values that cannot be measured.
Figures = Mapping[str, float | None]
#: Function from a case and the folder of prepared beds to figures.
Measure = Callable[[ballast.Case, str], Figures]


class Executor(Protocol):
    """Executor of points: one of `concurrent.futures`, or a `dask.distributed.Client`."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Any:
        """Schedules a call and returns its future."""


def grid(axes: Mapping[str, Iterable[Any]]) -> list[dict[str, Any]]:
    """Returns all combinations of the values of each axis as points.

    Args:
        axes: lists of values by dotted key path.

    Raises:
        TypeError: an axis is not a list of values.
        ValueError: an axis has no value.
    """
    if not isinstance(axes, Mapping):
        raise TypeError(f"axes: expected a dictionary from key paths to lists of values, found {axes!r}")
    lists = [_as_list(f"axis {name!r}", "a list of values", values) for name, values in axes.items()]
    for name, values in zip(axes, lists, strict=True):
        if not values:
            raise ValueError(f"axis {name!r}: expected at least one value, found none")
    return [dict(zip(axes, values, strict=True)) for values in itertools.product(*lists)]


def _as_list(place: str, expected: str, values: Any) -> list[Any]:
    """Returns the items of an iterable other than a string or mapping."""
    try:
        if not isinstance(values, str | bytes | Mapping):
            return list(iter(values))
    except TypeError:
        pass
    raise TypeError(f"{place}: expected {expected}, found {values!r}")


def _checked_points(points: Any) -> list[Point]:
    listed = _as_list("points", "a list of points, such as from study.grid", points)
    for i, point in enumerate(listed):
        _check_point(f"points[{i}]", point)
    return listed


def _check_point(place: str, point: object) -> None:
    if not isinstance(point, Mapping):
        raise TypeError(f"{place}: expected a dictionary from key paths to values, found {point!r}")


def latin_hypercube(
    ranges: Mapping[str, tuple[float, float]],
    n: int,
    *,
    seed: int = 0,
    integers: Collection[str] = (),
) -> list[dict[str, float]]:
    """Returns `n` points that fill the ranges evenly: each axis has one point in each `n`-th of its range.

    Args:
        ranges: lowest and highest value by dotted key path.
        n: number of points.
        seed: seed of the sample.
        integers: axes with whole numbers, including both ends of their range, such as "seed".

    Raises:
        TypeError: an argument has the wrong type.
        ValueError: a range is empty or not finite, or `integers` names an unknown axis.
    """
    from scipy.stats import qmc

    if not isinstance(ranges, Mapping):
        raise TypeError(f"ranges: expected a dictionary from key paths to (lowest, highest), found {ranges!r}")
    if not isinstance(n, numbers.Integral) or n < 0:
        raise ValueError(f"n: expected a whole number, 0 or more, found {n!r}")
    integers = _as_list("integers", "a list of names of axes", integers)
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

    def value(name: str, fraction: float) -> float:
        low, high = ranges[name]
        if name in integers:
            return min(math.floor(low + fraction * (high + 1 - low)), int(high))
        return low + fraction * (high - low)

    sample = qmc.LatinHypercube(len(ranges), rng=seed).random(n)
    return [
        {name: value(name, float(fraction)) for name, fraction in zip(ranges, row, strict=True)}
        for row in sample
    ]


def apply(case: ballast.Case, point: Point) -> ballast.Case:
    """Returns the case of a point.

    Raises:
        CaseError: the values of the point do not make a valid case.
        TypeError: the point is not a dictionary, or a value has the wrong type.
    """
    _check_point("point", point)
    values = {key: value for key, value in _with_one_seed(point).items() if key != "seed"}
    changed = case.with_values(values) if values else case
    return changed.choose(seed=point.get("seed"))


def _with_one_seed(point: Point) -> Point:
    """Returns a point, unless it sets the bed's seed by both of its names."""
    if "seed" in point and "bed.seed" in point:
        found = f"{point['seed']} and {point['bed.seed']}"
        error = ballast.CaseError(f"expected one seed of the bed, as seed or bed.seed, found {found}")
        error.code = "case"
        raise error
    return point


@contextlib.contextmanager
def _naming(point: Point) -> Iterator[None]:
    """Prefixes the messages of exceptions with the point."""
    try:
        yield
    except (ballast.Error, TypeError, ValueError) as error:
        error.args = (f"point {dict(point)}: {error}", *error.args[1:])
        raise


def _applied(case: ballast.Case, point: Point) -> ballast.Case:
    with _naming(point):
        return apply(case, point)


def run_tamping_cycle(case: ballast.Case, bed_cache: str) -> Figures:
    """Runs the tamping cycle of a case on one thread and returns its figures; the default measure of `run`.

    Figures of each zone: "ZONE: initial compactness" and "ZONE: final compactness". Of each tine in the squeeze, from moving
    averages over 4 ms: "TINE: mean force N" and "TINE: peak force N", both of magnitudes. Of the run: "work J" of all tines,
    "max penetration m", "steps not converged" (fraction; only with a tolerance), and "compaction per kJ" (mean gain of
    compactness under the sleepers per work).

    Raises:
        Error: a step cannot be computed.
    """
    tamped = tamped_sleepers(case)
    has_tolerance = case.to_dict().get("solver", {}).get("tolerance") != 0
    with ballast.open(case, bed_cache=bed_cache, threads=1, progress=False) as sim:
        tines = [tine.name for tine in sim.tines]
        initial = {name: zone.compactness for name, zone in sim.zones().items()}
        squeeze_forces: dict[str, list[float]] = {name: [] for name in tines}
        work = max_penetration = 0.0
        not_converged = 0
        steps = case.duration_ns // case.step_ns
        for _ in range(steps):
            phase = sim.phase
            result = sim.step_tamping_cycle()
            if result.status not in ("ok", "warn"):
                raise ballast.Error(f"{result!r}: {result.error_message}")
            work += sum(result[name].work for name in tines)
            not_converged += result.solver.steps_not_converged
            max_penetration = max(max_penetration, result.solver.max_penetration)
            if phase == "squeeze":
                for name in tines:
                    force = result[name].moving_average_force
                    squeeze_forces[name].append(float((force @ force) ** 0.5))
        final = {name: zone.compactness for name, zone in sim.zones().items()}
    figures: dict[str, float] = {}
    gains = []
    for name, start in initial.items():
        end = final[name]
        if start is None or end is None:
            continue
        figures[f"{name}: initial compactness"] = start
        figures[f"{name}: final compactness"] = end
        if is_under(name, tamped):
            gains.append(end - start)
    for name, forces in squeeze_forces.items():
        if forces:
            figures[f"{name}: mean force N"] = sum(forces) / len(forces)
            figures[f"{name}: peak force N"] = max(forces)
    figures["work J"] = work
    figures["max penetration m"] = max_penetration
    if has_tolerance:
        figures["steps not converged"] = not_converged / max(steps, 1)
    if gains and work > 0.0:
        figures["compaction per kJ"] = sum(gains) / len(gains) / (work * 1e-3)
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
    """Runs all points that the folder does not contain yet; returns the table of all points.

    Each finished point is a file of the folder, so a stopped study continues where it was, with more points or from another
    process too. A point is run again if its case, values, measure, bed key or the version of the package has changed. Use a
    new folder for a build that computes differently on the same beds. A failed point is reported at once and in the column
    `error`; the next call tries it again. Invalid points raise before anything is run.

    If a worker process is killed, for example out of memory, the running points are repeated one by one; only a point whose
    process is killed again fails.

    Args:
        case: a `Case` or the path of a case file (TOML).
        points: see `grid` and `latin_hypercube`.
        folder: folder of the study.
        measure: a function from a case and a folder of beds to figures, or `functools.partial` of one. Functions of a script
            or notebook are sent to the processes by value. Changed code, or changed values that it binds or closes over,
            run all points again; functions that it calls and globals are not compared. The compiled code counts: another
            version of Python runs its points again.
        jobs: number of processes; default: one per processor. Refused together with `executor`.
        executor: executor to use instead of processes of this machine, such as a `dask.distributed.Client`.
        bed_cache: folder of prepared beds.
        progress: print a line per point on stderr.

    Raises:
        CaseError: a point is not a valid case.
        FileError: a file of the folder is damaged.
        ImportError: pandas or loky is not installed.
        TypeError: an argument has the wrong type, or the measure cannot be sent to other processes.
    """
    if jobs is not None and not (isinstance(jobs, numbers.Integral) and jobs > 0):
        raise ValueError(f"jobs: expected a whole number, 1 or more, found {jobs!r}")
    if jobs is not None and executor is not None:
        raise TypeError("run: jobs: expected none with executor, which has its own")
    _require("pandas", *(() if executor is not None else ("loky",)))
    base = case if isinstance(case, ballast.Case) else ballast.Case.load(case)
    points = _checked_points(points)
    cases = [_applied(base, point) for point in points]
    keys = [
        _identity.point_key(base, case.bed_key, point, measure) for case, point in zip(cases, points, strict=True)
    ]
    store = Path(folder)
    store.mkdir(parents=True, exist_ok=True)
    files = [store / f"{key}.json" for key in keys]
    for file in filter(Path.exists, files):
        _read_figures(file)
    # Equal points share a file.
    first = {file: i for i, file in reversed([*enumerate(files)])}
    missing = sorted(i for file, i in first.items() if not file.exists())
    errors: dict[Path, str] = {}

    def report(text: str) -> None:
        if progress:
            show(f"study: {text}")

    def fail(i: int, error: str) -> None:
        errors[files[i]] = error
        report(f"{dict(points[i])} failed: {error}")

    def keep(i: int, figures: str) -> None:
        # For readers; the name of the file identifies the point.
        content = {
            "case": cases[i].name,
            "seed": cases[i].seed,
            "bed": cases[i].bed_key,
            "measure": _identity.measure_name(measure),
            "version": ballast.__version__,
            "point": dict(points[i]),
            "figures": json.loads(figures),
        }
        _ballast._replace_file(files[i], dumps(with_text_for_nonfinite(content), indent=1))
        report(f"{dict(points[i])} done, {sum(not file.exists() for file in first)} left")

    def run_all(calls: dict[int, _pool.Call], on_result: _pool.OnResult) -> None:
        if executor is None:
            _pool.run_in_processes(calls, jobs, on_result, fail)
        else:
            futures = {i: executor.submit(_pool.call_safely, *call) for i, call in calls.items()}
            _pool.wait_for(futures, on_result, fail)

    if missing and executor is None:
        _pool.check_picklable(measure)
    # Beds first: points that share one would all prepare it.
    shared = {cases[i].bed_key: i for i in missing}
    run_all({i: (_prepare_bed, cases[i], str(bed_cache)) for i in shared.values()}, lambda i, result: None)
    for i in missing:
        bed_error = errors.get(files[shared[cases[i].bed_key]])
        if bed_error is not None and files[i] not in errors:
            fail(i, bed_error)
    names = {i: tuple(points[i]) for i in missing if files[i] not in errors}
    code = _identity.code_digest(measure)
    run_all({i: (_run_point, cases[i], str(bed_cache), measure, code, names[i]) for i in names}, keep)
    return _table(points, files, errors)


def statistics_over_beds(table: pd.DataFrame | str | os.PathLike[str], by: Collection[str] = ()) -> pd.DataFrame:
    """Returns mean, standard deviation, least and largest value and number of values of each figure over beds.

    Args:
        table: a table of `run`, or the path of the `table.csv` of `ballast sweep`.
        by: columns of settings; beds with different values of these are kept apart.

    Returns:
        A table with a row per figure, and per combination of the values of `by` before it.

    Raises:
        ValueError: the table has no column of a name in `by`.
    """
    import pandas as pd

    frame = table if isinstance(table, pd.DataFrame) else pd.read_csv(table)
    if missing := [name for name in by if name not in frame]:
        raise ValueError(f"by: expected columns of the table, found {missing}; it has {list(frame)}")
    labels = ["number", "seed", "bed.seed", "error", *by]
    figures = frame.drop(columns=labels, errors="ignore").select_dtypes("number").columns
    summaries = ["mean", "std", "min", "max", "count"]
    if not by:
        return frame[figures].agg(summaries).T
    groups = {key: group[figures].agg(summaries).T for key, group in frame.groupby(list(by))}
    return pd.concat(groups, names=[*by, "figure"])


def write_sweep_plan(
    case: str | os.PathLike[str], points: Iterable[Point], path: str | os.PathLike[str]
) -> None:
    """Writes points as a plan of `ballast sweep`, which runs them without Python, also as array jobs of a scheduler.

    Args:
        case: path of the case file, relative to the plan.
        points: see `grid` and `latin_hypercube`.
        path: file to write; an existing file is replaced only if it is a plan.

    Raises:
        FileError: the file cannot be written, or `path` is a file of another kind.
        TypeError: TOML cannot hold a value.
    """
    named = []
    for point in _checked_points(points):
        with _naming(point):
            values = _with_one_seed(point).items()
        named.append({"bed.seed" if key == "seed" else key: value for key, value in values})
    _ballast._write_sweep_plan(os.fspath(case), named, path)


def _require(*modules: str) -> None:
    """Raises ImportError before any work begins if a module is missing."""
    for module in modules:
        try:
            importlib.import_module(module)
        except ImportError as error:
            raise ImportError(f"study.run: {module} is not installed; pip install 'ballast[study]'") from error


def _prepare_bed(case: ballast.Case, bed_cache: str) -> None:
    ballast.prepare(case, bed_cache=bed_cache, threads=1, progress=False)


def _run_point(case: ballast.Case, bed_cache: str, measure: Measure, code: str, names: Collection[str]) -> str:
    """Returns the figures of a point as JSON: other processes may not know their types.

    `code` is the measure's code in the process that started the study, `names` are the point's keys.
    """
    if _identity.code_digest(measure) != code:
        raise ballast.Error(
            f"measure: expected the code of {_identity.measure_name(measure)} that the study was started with, found other "
            "code: its file has changed, or the processes run two versions of Python; restart both"
        )
    figures = measure(case, bed_cache)
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


def _read_figures(file: Path) -> Figures:
    """Returns the figures of a finished point."""
    try:
        figures = json.loads(file.read_text())["figures"]
        if isinstance(figures, dict):
            return {name: float(value) if isinstance(value, str) else value for name, value in figures.items()}
    except (ValueError, KeyError, TypeError):
        pass
    error = ballast.FileError(f"{file}: expected the figures of a point (JSON), found something else; delete the file")
    error.code = "file"
    raise error


def _table(points: Sequence[Point], files: Sequence[Path], errors: Mapping[Path, str]) -> pd.DataFrame:
    import pandas as pd

    rows = []
    for point, file in zip(points, files, strict=True):
        figures = _read_figures(file) if file.exists() else {}
        rows.append({**point, **figures, "error": errors.get(file)})
    return pd.DataFrame(rows, columns=None if rows else ["error"])

"""Ballast simulation to which a machine or track model can be coupled.

    import ballast

    with ballast.open("examples/first.toml") as sim:
        result = sim.advance_to(10 * sim.step_ns)
        print(result["tine_1_minus"].mean_force)      # N, ballast on tine

SI units. World frame right-handed, z up. Quaternions are x, y, z, w. Times are whole nanoseconds since the start of
the run. Forces and impulses are those of the ballast on a body.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import SupportsIndex

from . import _ballast
from ._ballast import (
    BodyResult,
    Case,
    CaseError,
    EnergyLedger,
    Error,
    FileError,
    InternalError,
    Load,
    Motion,
    Mount,
    Recording,
    RemoteError,
    RequestError,
    Results,
    Simulation,
    SolverResult,
    Squeeze,
    State,
    StepSeries,
    Tine,
    WindowResult,
    ZoneResult,
    __version__,
    schema,
)
from ._progress import ProgressCallback, progress_callback

Mapping.register(WindowResult)

__all__ = [
    "BodyResult",
    "Case",
    "CaseError",
    "EnergyLedger",
    "Error",
    "FileError",
    "InternalError",
    "Load",
    "Motion",
    "Mount",
    "Recording",
    "RemoteError",
    "RequestError",
    "Results",
    "Simulation",
    "SolverResult",
    "Squeeze",
    "State",
    "StepSeries",
    "Tine",
    "WindowResult",
    "ZoneResult",
    "__version__",
    "open",
    "prepare",
    "read",
    "resume",
    "schema",
]

Path = str | os.PathLike[str]
#: Default folder of prepared beds.
DEFAULT_BED_CACHE = "runs/beds"


def _chosen_case(case: Case | Path, seed: SupportsIndex | None, schedule: str | None) -> Case:
    loaded = case if isinstance(case, Case) else Case.load(case)
    return loaded.choose(seed=seed, schedule=schedule)


def _refuse_options(options: Mapping[str, object], reason: str) -> None:
    """Raises TypeError for options that would have no effect."""
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise TypeError(f"open: {', '.join(given)}: {reason}")


def open(
    case: Case | Path,
    *,
    seed: SupportsIndex | None = None,
    schedule: str | None = None,
    threads: int | None = None,
    bed_cache: Path = DEFAULT_BED_CACHE,
    progress: bool | ProgressCallback = True,
    max_penetration: float | None = None,
    keep_partial_window: bool = False,
    connect: str | Sequence[str] | None = None,
    listen: str | Sequence[str] | None = None,
    config: Path | None = None,
) -> Simulation:
    """Returns a simulation at the start of a case, or of a remote component.

    The bed of a case is prepared unless the cache has it. `open("zenoh:SITE/ID")` drives a component that `ballast serve`
    computes, from the current time of its run. Equal windows give equal results and hashes in both.

    Args:
        case: a `Case`, the path of a case file (TOML), or "zenoh:SITE/ID".
        seed: seed of the bed; default: the case's.
        schedule: "sequential", "synchronous" or "asynchronous"; default: the case's.
        threads: number of computing threads; default: one per processor.
        bed_cache: folder of prepared beds, shared with `ballast run`.
        progress: show the progress of a preparation, or a callback `progress(fraction, text)`.
        max_penetration: penetration that ends a window, m, above 0; None: no limit.
        keep_partial_window: if a window fails, keep the state of its last valid step (status "early") instead of returning
            to its start ("discard").
        connect: endpoint or endpoints to connect to ("zenoh:" only); default: tcp/127.0.0.1:7447.
        listen: endpoint or endpoints to listen on ("zenoh:" only).
        config: Zenoh configuration file (JSON5) with TLS, users and routers ("zenoh:" only).

    Raises:
        CaseError: the case is not valid.
        FileError: a file cannot be read or written.
        RequestError: an argument is out of range, or another client owns the component.
        RemoteError: the component does not answer.
        TypeError: an option has no effect for this kind of case.
    """
    network = {"connect": connect, "listen": listen, "config": config}
    if isinstance(case, str) and case.startswith("zenoh:"):
        choices = {"seed": seed, "schedule": schedule, "threads": threads, "max_penetration": max_penetration}
        beds = None if os.fspath(bed_cache) == DEFAULT_BED_CACHE else bed_cache
        others = {"keep_partial_window": keep_partial_window or None, "bed_cache": beds}
        _refuse_options({**choices, **others}, f"{case}: set by the server of the component")
        return _ballast._attach(
            case.removeprefix("zenoh:"), _endpoints("connect", connect), _endpoints("listen", listen), config
        )
    _refuse_options(network, 'only for "zenoh:SITE/ID"')
    chosen = _chosen_case(case, seed, schedule)
    with progress_callback(progress, f"bed of {chosen.name}") as callback:
        return _ballast._open(chosen, bed_cache, threads, callback, max_penetration, keep_partial_window)


def _endpoints(name: str, endpoints: str | Sequence[str] | None) -> Sequence[str] | None:
    if endpoints == "":
        raise TypeError(f"{name}: expected an endpoint, such as tcp/127.0.0.1:7447, or several, found ''")
    return [endpoints] if isinstance(endpoints, str) else endpoints


def resume(
    state: State | Path,
    *,
    threads: int | None = None,
    max_penetration: float | None = None,
    keep_partial_window: bool = False,
) -> Simulation:
    """Returns a simulation that continues from a saved state, bit for bit as without the interruption.

    Args:
        state: a `State`, a file of `State.write`, a checkpoint of `ballast run`, or the folder of a run.
        threads: number of computing threads; default: one per processor.
        max_penetration: penetration that ends a window, m; default: the limit of the simulation that saved the state;
            `math.inf`: no limit.
        keep_partial_window: see `open`.

    Raises:
        FileError: the file cannot be read.
        RequestError: an argument is out of range, or the state belongs to a remote simulation.
    """
    saved = state if isinstance(state, State) else State.read(_run_file(state, "checkpoint.h5"))
    return _ballast._resume(saved, threads, max_penetration, keep_partial_window)


def prepare(
    case: Case | Path,
    *,
    seed: SupportsIndex | None = None,
    threads: int | None = None,
    bed_cache: Path = DEFAULT_BED_CACHE,
    progress: bool | ProgressCallback = True,
    rebuild: bool = False,
) -> str:
    """Prepares the bed of a case unless the cache has it; returns the path of its file.

    Args:
        case: a `Case` or the path of a case file (TOML).
        seed: seed of the bed; default: the case's.
        threads: number of computing threads; default: one per processor.
        bed_cache: folder of prepared beds.
        progress: show the progress, or a callback `progress(fraction, text)`.
        rebuild: prepare the bed even if the cache has it.

    Raises:
        CaseError: the case is not valid.
        FileError: a file cannot be read or written.
    """
    chosen = _chosen_case(case, seed, None)
    with progress_callback(progress, f"bed of {chosen.name}") as callback:
        return str(_ballast._prepare(chosen, bed_cache, threads, callback, rebuild))


def _run_file(path: Path, name: str) -> Path:
    """Returns the file `name` if `path` is the folder of a run, else `path`."""
    return os.path.join(path, name) if os.path.isdir(path) else path


def read(path: Path) -> Results | Recording | State:
    """Reads results (`.vtkhdf`), a recording (`.mcap`) or a checkpoint (`.h5`) of a run.

    The first bytes decide, whatever the file's name. The folder of a run stands for its results.

    Raises:
        FileError: the file cannot be read, or is of another kind.
    """
    path = _run_file(path, "results.vtkhdf")
    start = b""
    # Reading from a pipe would block. The reader reports files that cannot be read.
    if os.path.isfile(path):
        with suppress(OSError), io.open(path, "rb") as file:
            start = file.read(64)
    suffix = os.path.splitext(os.fspath(path))[1].lower()
    readers: dict[str, Callable[[Path], Results | Recording | State]] = {".mcap": Recording, ".h5": State.read}
    for magic, own_suffix in ((b"\x89MCAP0", ".mcap"), (b"ballast-checkpoint", ".h5"), (b"\x89HDF", ".vtkhdf")):
        if start.startswith(magic):
            suffix = own_suffix
    return readers.get(suffix, Results)(path)

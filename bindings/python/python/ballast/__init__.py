"""The ballast model that a machine or track model can be coupled to.

    import ballast

    with ballast.open("examples/first.toml") as sim:
        out = sim.advance_to(10 * sim.step_ns)
        print(out["tine_1_minus"].mean_force)      # N, by the ballast on the tine

SI units throughout. World frame right-handed, z up. Quaternions are x, y, z, w. Times are whole
nanoseconds since the start of the run. Forces and impulses are those of the ballast on a body.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import SupportsIndex

from . import _ballast
from ._ballast import (
    BodyOutcome,
    Case,
    CaseError,
    EnergyLedger,
    Error,
    FileError,
    Load,
    Lost,
    Motion,
    Mount,
    Outcome,
    Recording,
    Refused,
    Results,
    Series,
    Simulation,
    SolverOutcome,
    Squeeze,
    State,
    Tine,
    Unreachable,
    ZoneOutcome,
    __version__,
    schema,
)
from ._progress import Progress

Mapping.register(Outcome)

__all__ = [
    "BodyOutcome",
    "Case",
    "CaseError",
    "EnergyLedger",
    "Error",
    "FileError",
    "Load",
    "Lost",
    "Motion",
    "Mount",
    "Outcome",
    "Recording",
    "Refused",
    "Results",
    "Series",
    "Simulation",
    "SolverOutcome",
    "Squeeze",
    "State",
    "Tine",
    "Unreachable",
    "ZoneOutcome",
    "__version__",
    "open",
    "prepare",
    "read",
    "resume",
    "schema",
]

Path = str | os.PathLike[str]
#: Called with a share from 0 to 1 and a few words.
OnProgress = Callable[[float, str], object]


def _case(case: Case | Path, seed: SupportsIndex | None, schedule: str | None) -> Case:
    loaded = case if isinstance(case, Case) else Case.load(case)
    return loaded.choose(seed=seed, schedule=schedule)


def _unused(options: Mapping[str, object], why: str) -> None:
    """Options that would be ignored are a mistake."""
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise TypeError(f"open: {', '.join(given)}: {why}")


def open(
    case: Case | Path,
    *,
    seed: SupportsIndex | None = None,
    schedule: str | None = None,
    threads: int | None = None,
    beds: Path = "runs/beds",
    progress: bool | OnProgress = True,
    max_penetration: float | None = None,
    keep_early: bool = False,
    connect: str | Sequence[str] | None = None,
    listen: str | Sequence[str] | None = None,
    config: Path | None = None,
) -> Simulation:
    """Opens a case at the start of its run; its bed is prepared if it is not in the folder `beds`.

    `open("zenoh:SITE/ID")` drives the component of this name instead, which `ballast serve` computes, from where
    its run stands: the same windows give the same outcomes and hashes.

    Args:
        case: a `Case`, the path of a case file (TOML), or "zenoh:SITE/ID".
        seed: of the bed, instead of the case's.
        schedule: "sequential", "synchronous" or "asynchronous", instead of the case's.
        threads: workers of this simulation; by default one per processor.
        beds: folder of prepared beds, found again by content; `ballast run` uses the same.
        progress: show how far a preparation is, or a function that is told.
        max_penetration: m; above 0; a step that goes deeper ends its window. None: any depth.
        keep_early: what a window that cannot be computed to its end leaves: the state of the last
            sound step (status "early") rather than that of its beginning ("discard").
        connect: "zenoh:" only: an endpoint to connect to, or several; by default tcp/127.0.0.1:7447, where `ballast serve`
            listens.
        listen: "zenoh:" only: an endpoint to listen on, or several.
        config: "zenoh:" only: a configuration file of Zenoh (JSON5): TLS, users, routers.

    Raises:
        CaseError: the case describes no run.
        FileError: a file cannot be read or written.
        Refused: another client drives the component.
        Unreachable: the component does not answer.
    """
    network = {"connect": connect, "listen": listen, "config": config}
    if isinstance(case, str) and case.startswith("zenoh:"):
        choices = {"seed": seed, "schedule": schedule, "threads": threads, "max_penetration": max_penetration}
        others = {"keep_early": keep_early or None, "beds": None if os.fspath(beds) == "runs/beds" else beds}
        _unused({**choices, **others}, f"{case}: whoever serves the case chooses it")
        endpoints = (_several("connect", connect), _several("listen", listen))
        return _ballast.attach(case.removeprefix("zenoh:"), *endpoints, config)
    _unused(network, 'how to reach a component is for "zenoh:SITE/ID"')
    chosen = _case(case, seed, schedule)
    with Progress.of(progress, f"bed of {chosen.name}") as tell:
        return _ballast.begin(chosen, beds, threads, tell, max_penetration, keep_early)


def _several(name: str, endpoints: str | Sequence[str] | None) -> Sequence[str] | None:
    if endpoints == "":
        raise TypeError(f"{name}: expected an endpoint, such as tcp/127.0.0.1:7447, or several, found ''")
    return [endpoints] if isinstance(endpoints, str) else endpoints


def resume(
    state: State | Path,
    *,
    threads: int | None = None,
    max_penetration: float | None = None,
    keep_early: bool = False,
) -> Simulation:
    """A simulation that goes on from a saved state, or from a file: of `State.write`, or a checkpoint of
    `ballast run`, of which the folder may be given. It goes on to the same bytes as one that was never interrupted.

    Without `max_penetration` the limit is that of the simulation that saved the state; `math.inf`: any depth."""
    saved = state if isinstance(state, State) else State.read(_in_run(state, "checkpoint.h5"))
    return _ballast.resume(saved, threads, max_penetration, keep_early)


def prepare(
    case: Case | Path,
    *,
    seed: SupportsIndex | None = None,
    threads: int | None = None,
    beds: Path = "runs/beds",
    progress: bool | OnProgress = True,
    again: bool = False,
) -> str:
    """Prepares the bed of a case unless it is there; returns the path of its file."""
    chosen = _case(case, seed, None)
    with Progress.of(progress, f"bed of {chosen.name}") as tell:
        return str(_ballast.prepare(chosen, beds, threads, tell, again))


def _in_run(path: Path, name: str) -> Path:
    """A file of a run whose folder may be given instead, as to the program."""
    return os.path.join(path, name) if os.path.isdir(path) else path


def read(path: Path) -> Results | Recording | State:
    """Reads what a run has left: results (`.vtkhdf`), a recording (`.mcap`) or a checkpoint (`.h5`), told by its first bytes,
    whatever the file is called. Of the folder of a run, its results."""
    path = _in_run(path, "results.vtkhdf")
    start = b""
    # A pipe would be waited for. What cannot be read, its reader tells of.
    if os.path.isfile(path):
        with suppress(OSError), io.open(path, "rb") as file:
            start = file.read(64)
    suffix = os.path.splitext(os.fspath(path))[1].lower()
    readers: dict[str, Callable[[Path], Results | Recording | State]] = {".mcap": Recording, ".h5": State.read}
    reader = readers.get(suffix, Results)
    for begins, own in ((b"\x89MCAP0", ".mcap"), (b"ballast-checkpoint", ".h5"), (b"\x89HDF", ".vtkhdf")):
        if start.startswith(begins):
            reader = readers.get(own, Results)
    return reader(path)

"""Compiled part of `ballast`. SI units; world axes, z up; quaternions x, y, z, w; times in ns.

Array shapes use ng for grains, nd for driven bodies, nc for contact points and n for knots, steps or rows.
"""

import os
from collections.abc import Callable, ItemsView, Iterator, KeysView, Mapping, Sequence, ValuesView
from typing import Any, SupportsIndex, TypeVar, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path = str | os.PathLike[str]
_Floats = NDArray[np.float64]
_Times = Sequence[SupportsIndex] | NDArray[np.integer[Any]]
_Default = TypeVar("_Default")

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
    "schema",
]
__version__: str

class Error(Exception):
    """Base class of all Ballast errors; `code` identifies the error.

    Codes of this class itself: "busy" (another thread is stepping the simulation, or a signal handler tries to compute
    with the threads that it interrupts), "closed" (the simulation was closed), "threads" (the threads cannot be started).
    """

    code: str

class CaseError(Error):
    """Error in a case; `diagnostics` lists every error with its key and line. The code is "case"."""

    diagnostics: tuple[dict[str, Any], ...]

class RequestError(Error):
    """Invalid request; the simulation has not changed.

    Where the message has parts, they are also attributes: `place` (an argument, or the body that an input is for),
    `expected`, `found`, and for "time_grid" `nearest_ns` (the neighbouring times at which a window may end, ns).

    code: "time_grid", "input_gap", "input_jump", "input_invalid", "unknown_body", "nothing_to_redo", "state_invalid",
    "parameter_invalid", "recording", "forked_process" (the operation needs the process that created the object),
    "remote_unsupported" (only a simulation of this process supports the operation). Remote components also refuse with
    "busy", "unknown_state", "too_many_states" and other codes of their control plane.
    """

    place: str | None
    expected: str | None
    found: str | None
    nearest_ns: tuple[int, int] | None

class RemoteError(Error):
    """A remote component did not answer correctly. Repeating the same call is safe: windows are computed once.

    code: "invalid_name", "timeout" (alive, no reply), "disconnected", "diverged" (another client changed the run;
    only `restore` helps), "transport", "bad_reply", "cancelled" (by `stop` or `close`).
    """

class FileError(Error):
    """A file cannot be read or written. The code is "file"."""

class InternalError(Error):
    """A bug in Ballast (a Rust panic). Only `restore` of a saved state makes the simulation usable again.

    The code is "internal".
    """

@final
class Case:
    """A validated case: the description of a bed, its machine and a run.

    Cases with the same text, seed and schedule are equal. They can be copied and pickled.

    Args:
        text: the case (TOML).
        name: name of the text in error messages.

    Raises:
        CaseError: the text is not a valid case.
    """

    def __new__(cls, text: str, name: str = "case") -> Case: ...
    @staticmethod
    def load(path: _Path) -> Case:
        """Reads a case file (TOML).

        Raises:
            CaseError: the file is not a valid case; `diagnostics` has every error with its line.
            FileError: the file cannot be read.
        """

    @staticmethod
    def from_dict(values: dict[str, Any]) -> Case:
        """Returns the case that nested dictionaries describe; numpy scalars and arrays are accepted as values.

        Raises:
            CaseError: the values are not a valid case.
            TypeError: TOML cannot hold a value.
        """

    def to_dict(self) -> dict[str, Any]:
        """Returns the values of the case's text as nested dictionaries. Defaults that the text omits are not included."""

    def write(self, path: _Path) -> None:
        """Writes the case's text to a file. An existing file is replaced only if it is TOML.

        Raises:
            FileError: the file cannot be written, or `path` is a file of another kind.
        """

    def with_values(self, values: dict[str, Any]) -> Case:
        """Returns a copy of the case with changed values.

        Args:
            values: new values by dotted key path, such as `{"tamping.vibration.frequency_Hz": 40.0}`.

        Raises:
            CaseError: the changed case is not valid.
            TypeError: TOML cannot hold a value.
        """

    def choose(self, *, seed: SupportsIndex | None = None, schedule: str | None = None) -> Case:
        """Returns a copy of the case with another seed of the bed or another schedule of the solver.

        Args:
            seed: seed of the bed, 0 to 2^64 - 1.
            schedule: "sequential", "synchronous" or "asynchronous".

        Raises:
            CaseError: the schedule is unknown.
            RequestError: the seed is out of range.
        """

    @property
    def name(self) -> str:
        """Name of the case, from its text."""

    @property
    def text(self) -> str:
        """Text of the case (TOML), including a seed or schedule set by `choose`.

        Raises:
            CaseError: TOML cannot hold the seed (above 2^63 - 1).
        """

    @property
    def seed(self) -> int:
        """Seed of the bed."""

    @property
    def schedule(self) -> str:
        """Schedule of the solver: "sequential", "synchronous" or "asynchronous"."""

    @property
    def step_ns(self) -> int:
        """Length of a time step, ns."""

    @property
    def duration_ns(self) -> int:
        """Duration of the case's run, ns."""

    @property
    def warnings(self) -> list[str]:
        """Warnings about valid but implausible values."""

    @property
    def bed_key(self) -> str:
        """Key of the prepared bed: a hash of all values that its preparation depends on."""

    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Callable[..., Case], tuple[str, int | None, str | None]]: ...

@final
class Motion:
    """Motion of a driven body, or of its mount, through a window: knots that are interpolated but never extrapolated.

    Args:
        times_ns: (n,) times of the knots in ascending order, ns. The first is at or before the start of the window, the
            last at or after its end.
        positions: (n, 3) positions of the body's reference point, m.
        orientations: (n, 4) unit quaternions x, y, z, w; default: identity.
        velocities: (n, 3) velocities of the reference point, m/s.
        angular_velocities: (n, 3) angular velocities, world axes, rad/s; default: zero. Required with "hermite" if the
            orientations differ.
        interpolation: "hermite" (cubic through poses and velocities; default with velocities), "linear" (default without
            velocities) or "hold" (piecewise constant).
        allow_jump: allow the motion to start at another pose or velocity than the last commanded one.

    Raises:
        RequestError: an array has the wrong shape, or a value is not a finite real number.
    """

    def __new__(
        cls,
        times_ns: _Times,
        positions: ArrayLike,
        orientations: ArrayLike | None = None,
        *,
        velocities: ArrayLike | None = None,
        angular_velocities: ArrayLike | None = None,
        interpolation: str | None = None,
        allow_jump: bool = False,
    ) -> Motion: ...
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Returns the constructor's arguments, for pickling and copying."""

@final
class Load:
    """Load on a mounted body through a window, in addition to its weight; spring directions already carry the weight.

    Args:
        times_ns: (n,) times of the knots in ascending order, ns.
        forces: (n, 3) forces, world axes, N.
        torques: (n, 3) torques about the body's reference point, world axes, N m; default: zero.
        interpolation: "linear" or "hold" (each value holds from its knot on).

    Raises:
        RequestError: an array has the wrong shape, or a value is not a finite real number.
    """

    def __new__(
        cls,
        times_ns: _Times,
        forces: ArrayLike,
        torques: ArrayLike | None = None,
        *,
        interpolation: str = "linear",
    ) -> Load: ...
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Returns the constructor's arguments, for pickling and copying."""

@final
class Simulation:
    """A ballast model advanced in windows. Created by `ballast.open` or `ballast.resume`.

    Threads: `advance_to` releases the GIL. One thread at a time may step a simulation; a second one gets
    `Error(code="busy")`. Different simulations run in parallel.

    Interrupting: Ctrl-C (main thread), `stop()` or `close()` cancel the running step. Completed steps are kept; see `last`.

    Remote components (`ballast.open("zenoh:SITE/ID")`): a cancelled window continues on the server, and repeating the
    call returns its result. Available: `advance_to`, `redo`, `last`, `save`, `restore`, `set_parameters`, `stop`,
    `close`, `now_ns`, `step_ns`, `schedule`, `bodies`, `grain_count`, `roles`, `mounts`, `tines`,
    `has_failed`, `is_closed`.
    Other methods raise `RequestError(code="remote_unsupported")`.
    """

    def __enter__(self) -> Simulation: ...
    def __exit__(self, *error: object) -> None: ...
    def advance_to(
        self,
        t1_ns: SupportsIndex,
        motions: Mapping[str, Motion] | None = None,
        loads: Mapping[str, Load] | None = None,
        *,
        record_steps: bool = False,
        zones: bool = False,
    ) -> WindowResult:
        """Advances the simulation to `t1_ns`.

        Args:
            t1_ns: end of the window, ns since the start of the run; a whole number of steps after `now_ns`.
            motions: motions of driven bodies by name. Other bodies keep their commanded pose; a body that its last cubic
                motion left moving needs a motion that continues it, or one with `allow_jump=True`.
            loads: loads on mounted bodies by name; other mounted bodies have none.
            record_steps: record the impulses of every step, see `WindowResult.step_series`.
            zones: measure the case's zones at the end of the window, see `WindowResult.zones`. This takes longer than
                the rest of a coupling step.

        Raises:
            RequestError: the request is invalid; the simulation has not changed.
            InternalError: a bug in Ballast; only `restore` makes the simulation usable again.
        """

    def redo(
        self,
        motions: Mapping[str, Motion] | None = None,
        loads: Mapping[str, Load] | None = None,
        *,
        record_steps: bool = False,
        zones: bool = False,
    ) -> WindowResult:
        """Computes the last window again from its start with other inputs, for implicit coupling.

        The window ends at the requested time, even if Ctrl-C, `stop` or an error ended it earlier the first time.
        Arguments and errors are those of `advance_to`.
        """

    def step_tamping_cycle(self, *, record_steps: bool = False, zones: bool = False) -> WindowResult:
        """Advances one step, in which the case moves tines and sleepers by its tamping cycle, and plates.

        The motion is that of `ballast run`, including the force limits of the case.
        """

    def stop(self) -> None:
        """Cancels the window that another thread is computing; later windows are not affected.

        The running step is dropped. The window's result has the code "stopped" and the status "early", or "discard" if
        no step was complete. A remote window continues on the server, and its caller gets
        `RemoteError(code="cancelled")`.
        """

    def save(self) -> State:
        """Returns the current state, with everything that the next window depends on. The data is shared, not copied."""

    def restore(self, state: State) -> None:
        """Restores a saved state of the same case.

        Raises:
            RequestError: the state belongs to another case, or a recording is open.
        """

    def probe_stiffness(
        self,
        sleeper: str | None = None,
        *,
        max_load: float = 20e3,
        min_load: float = 1e3,
        cycles: int = 2,
        ramp: float = 0.2,
    ) -> dict[str, Any]:
        """Loads a sleeper vertically and returns load over settlement; the simulation stays as it is.

        The sleeper is seated under its weight, loaded to `max_load` (N) in `ramp` (s), unloaded to `min_load`, and so on;
        its other degrees of freedom are held. Without a name it is the first sleeper.

        Returns:
            `time` (s), `load` (N, without the weight) and `settlement` (m) as arrays, and `cycles`: for each the secant
            stiffness of `loading` and `unloading` (N/m), the `settlement` at the largest load and the `rest` (m).

        Raises:
            RequestError: settings out of range, or an unknown sleeper.
        """

    def probe_push(
        self,
        sleeper: str | None = None,
        *,
        displacement: float = 5e-3,
        speed: float = 0.01,
        seating: float = 0.2,
    ) -> dict[str, Any]:
        """Pushes a sleeper towards +y and returns force over displacement; the simulation stays as it is.

        The sleeper is seated under its weight for `seating` (s), then moved to `displacement` (m) with `speed` (m/s). Without a
        name it is the first sleeper.

        Returns:
            `time` (s), `force` (N) and `displacement` (m) as arrays, `force_at_2_mm` (N; None below 2 mm) and the `weight` of the
            sleeper (N).

        Raises:
            RequestError: settings out of range, or an unknown sleeper.
        """

    def set_parameters(
        self,
        *,
        max_iterations: int | None = None,
        tolerance: float | None = None,
        max_penetration: float | None = None,
    ) -> None:
        """Sets solver parameters for all later windows and for a redo of the last one. Omitted parameters keep their value.

        Args:
            max_iterations: maximum number of iterations per step, at least 1.
            tolerance: residual below which a step counts as solved; 0: always use all iterations.
            max_penetration: penetration that ends a window, m; infinite: no limit.

        Raises:
            RequestError: a value is out of range; nothing has changed.
        """

    def fork(self) -> Simulation:
        """Returns an independent simulation that starts from the current state."""

    def record(self, path: _Path) -> None:
        """Starts recording all later windows in an MCAP file, which is replaced.

        If the file cannot be written later, a RuntimeWarning is issued and the simulation continues without recording.

        Raises:
            FileError: the file cannot be created.
            RequestError: a recording is open already.
        """

    def stop_recording(self) -> None:
        """Ends the recording, if one is open.

        Raises:
            FileError: the recording is incomplete.
        """

    def close(self) -> None:
        """Ends the simulation and its recording. Saved states and arrays stay valid.

        A window that another thread is computing is cancelled as by `stop`, and waited for.

        Raises:
            FileError: the recording is incomplete.
        """

    def zones(self) -> dict[str, ZoneResult]:
        """Measures the case's zones now; returns the results by name."""

    def shape(self, index: SupportsIndex) -> tuple[_Floats, list[list[int]]]:
        """Returns the corners (n, 3) of a shape in its own frame, m, and its faces.

        Each face is a list of corner indices, counter-clockwise seen from outside.
        """

    def parts(self, name: str) -> list[tuple[_Floats, list[list[int]]]]:
        """Returns the convex parts of a driven body: corners (n, 3) in the body's frame, m, and faces as in `shape`.

        Infinite walls have no parts.

        Raises:
            KeyError: no driven body has this name.
        """

    @property
    def last(self) -> WindowResult | None:
        """Result of the last window, even if its call raised an exception; None before the first and after `restore`."""

    @property
    def case(self) -> Case:
        """Case of the simulation."""

    @property
    def now_ns(self) -> int:
        """Simulated time, ns since the start of the run."""

    @property
    def step_ns(self) -> int:
        """Length of a time step, ns."""

    @property
    def schedule(self) -> str:
        """Schedule of the solver: "sequential", "synchronous" or "asynchronous"."""

    @property
    def threads(self) -> int:
        """Number of computing threads, including the calling one."""

    @property
    def bodies(self) -> list[str]:
        """Names of the driven bodies: tines, boundaries, sleepers and plates."""

    @property
    def roles(self) -> dict[str, str]:
        """Role of each driven body by name: "boundary", "plate", "sleeper" or "tine"."""

    @property
    def mounts(self) -> dict[str, Mount]:
        """Mounts by name of the driven bodies that loads can move. All other driven bodies have prescribed motion."""

    @property
    def tines(self) -> list[Tine]:
        """Paths of the tines in the case's tamping cycle; empty without tamping."""

    @property
    def phase(self) -> str:
        """Current phase of the tamping cycle: waiting, lift, insertion, squeeze, hold, withdrawal, release, traffic or done."""

    @property
    def grain_count(self) -> int:
        """Number of grains, ng."""

    @property
    def stones(self) -> dict[str, Any] | None:
        """Shape and grading of the stones, by mass, as in `ballast inspect --json`; None without stones."""

    @property
    def shape_indices(self) -> NDArray[np.uint32]:
        """Shape index of each grain (ng,), for `shape`."""

    @property
    def masses(self) -> _Floats:
        """Masses of the grains (ng,), kg."""

    @property
    def has_failed(self) -> bool:
        """True after an `InternalError`, until a saved state is restored."""

    @property
    def is_closed(self) -> bool:
        """True after `close`."""

    def _fail_next(self) -> None: ...

@final
class Mount:
    """Mount of a driven body that loads can move.

    In each direction the body follows its commanded motion, a spring that follows it, or only loads and contacts.
    """

    @property
    def mass(self) -> float:
        """Mass that moves with the body, kg."""

    @property
    def dof_modes(self) -> tuple[str, str, str, str, str, str]:
        """Mode of each degree of freedom x, y, z, rx, ry, rz: "prescribed", "spring" or "free"."""

    @property
    def stiffness(self) -> _Floats:
        """Spring stiffness of each degree of freedom (6,), N/m and N m/rad; 0 without a spring."""

    @property
    def damping(self) -> _Floats:
        """Spring damping of each degree of freedom (6,), N s/m and N m s/rad; 0 without a spring."""

@final
class Tine:
    """Path of a tine in the tamping cycle of its case."""

    @property
    def name(self) -> str:
        """Name of the tine's body."""

    @property
    def pair(self) -> int:
        """Number of the tine's pair in the case; its squeezes are those of "pair_NUMBER"."""

    @property
    def direction(self) -> float:
        """Direction of the squeeze along x: 1 or -1."""

    @property
    def start(self) -> _Floats:
        """Position of the reference point before the cycle (3,), m."""

    @property
    def full_depth_z(self) -> float:
        """Height of the reference point at full depth, m."""

    @property
    def stroke(self) -> float:
        """Closing of the tine in the squeeze, m."""

@final
class State:
    """A saved state. It can be copied without cost, pickled, and written to a file.

    Arrays are read-only views of the state's own memory. They keep their values while the simulation advances, and stay
    valid for as long as they are referenced.

    A state of a remote simulation stays on the server for as long as it is referenced here. It has `time_ns`, `hash`,
    `commanded_pose` and `commanded_twist`, and can be restored. Pickled, it is a reference: the server keeps the state after
    this simulation is closed or its process has ended, and a simulation of the same run in another process restores it.
    """

    @staticmethod
    def read(path: _Path) -> State:
        """Reads a file of `write`, or a checkpoint of `ballast run`.

        Raises:
            FileError: the file cannot be read, or is not the state of a run.
        """

    def write(self, path: _Path) -> None:
        """Writes the state to a file, from which another process continues bit for bit.

        An existing file is replaced only if it is a state, a bed or a checkpoint.

        Raises:
            FileError: the file cannot be written, or `path` is a file of another kind.
        """

    def __reduce__(self) -> tuple[Callable[..., State], tuple[object]]:
        """Pickles the state as the bytes of the file that `write` creates, that of a remote simulation as a reference."""

    def __copy__(self) -> State:
        """Returns the state itself, which is immutable."""

    def __deepcopy__(self, _memo: object) -> State: ...
    def body(self, name: str) -> tuple[_Floats, _Floats, _Floats, _Floats]:
        """Returns position (m), orientation (x, y, z, w), velocity (m/s) and angular velocity (rad/s) of a driven body.

        Raises:
            RequestError: no driven body has this name.
        """

    def commanded_pose(self, name: str) -> tuple[_Floats, _Floats]:
        """Returns the position (m) and orientation (x, y, z, w) at which the next motion of a driven body must start.

        It is the end of the last commanded motion of the body or of its mount.

        Raises:
            RequestError: no driven body has this name.
        """

    def commanded_twist(self, name: str) -> tuple[_Floats, _Floats] | None:
        """Returns the linear (m/s) and angular velocity (rad/s) at the end of the last commanded motion of a driven body.

        The next cubic motion must continue them. They are zero for a body without motion, and `None` after a linear or
        held motion, when any velocity is accepted.

        Raises:
            RequestError: no driven body has this name.
        """

    @property
    def time_ns(self) -> int:
        """Simulated time, ns since the start of the run."""

    @property
    def step(self) -> int:
        """Number of steps since the start of the run."""

    @property
    def hash(self) -> str:
        """Hash of the bodies: 128 bits as 32 hexadecimal digits, comparable with those of `ballast run`, `serve` and recordings."""

    @property
    def positions(self) -> _Floats:
        """Positions of the grains (ng, 3), m."""

    @property
    def orientations(self) -> _Floats:
        """Orientations of the grains (ng, 4), x, y, z, w."""

    @property
    def velocities(self) -> _Floats:
        """Velocities of the grains (ng, 3), m/s."""

    @property
    def angular_velocities(self) -> _Floats:
        """Angular velocities of the grains (ng, 3), world axes, rad/s."""

    @property
    def contact_bodies(self) -> NDArray[np.uint32]:
        """Indices of the two bodies of each contact point (nc, 2); driven bodies are numbered after the grains."""

    @property
    def contact_impulses(self) -> _Floats:
        """Impulses of the last step on the first body of each contact point (nc, 3), N s."""

    @property
    def contact_points(self) -> _Floats:
        """Positions of the contact points (nc, 3), m; a copy."""

@final
class WindowResult:
    """Result of a window: a mapping from the names of driven bodies to `BodyResult`. It can be copied and pickled."""

    def __iter__(self) -> Iterator[str]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, name: str, /) -> BodyResult: ...
    def __contains__(self, name: object, /) -> bool: ...
    def __reduce__(self) -> tuple[Callable[..., WindowResult], tuple[Any, ...]]: ...
    @overload
    def get(self, name: str, default: None = None) -> BodyResult | None:
        """Returns the result of a body, or `default` if no driven body has this name."""

    @overload
    def get(self, name: str, default: _Default) -> BodyResult | _Default:
        """Returns the result of a body, or `default` if no driven body has this name."""

    def keys(self) -> KeysView[str]:
        """Returns the names of the bodies."""

    def values(self) -> ValuesView[BodyResult]:
        """Returns the results of the bodies."""

    def items(self) -> ItemsView[str, BodyResult]:
        """Returns pairs of name and result of the bodies."""

    @property
    def status(self) -> str:
        """Status: "ok", "warn" (a step stopped at its iteration cap), "early" (ended early, valid state) or "discard" (rolled back)."""

    @property
    def code(self) -> str | None:
        """Code of the error that ended the window, or None.

        One of "over_speed", "penetration", "not_finite", "step_failed" and "stopped" (by `stop`, `close` or Ctrl-C).
        """

    @property
    def error_message(self) -> str | None:
        """Message of the error that ended the window, or None."""

    @property
    def t0_ns(self) -> int:
        """Start of the window, ns since the start of the run."""

    @property
    def t1_ns(self) -> int:
        """End of the window as far as it was computed, ns since the start of the run."""

    @property
    def steps(self) -> int:
        """Number of computed steps."""

    @property
    def bodies(self) -> dict[str, BodyResult]:
        """Results of the driven bodies by name."""

    @property
    def zones(self) -> dict[str, ZoneResult]:
        """Results of the zones by name at the end of the window; empty unless requested with `zones=True`."""

    @property
    def squeezes(self) -> dict[str, Squeeze]:
        """Squeezes in progress during the window, by pair of tines ("pair_0"); the later one if a pair had two.

        docs/src/coupling/concepts.md defines when a squeeze starts and ends.
        """

    @property
    def solver(self) -> SolverResult:
        """Result of the contact solver."""

    @property
    def energy(self) -> EnergyLedger:
        """Energies since the start of the run."""

    @property
    def max_knot_spacing_ns(self) -> int:
        """Largest sensible spacing of motion knots at the bodies' current speed, ns; 0 if nothing moves or in a recording."""

    @property
    def wall_time_s(self) -> float:
        """Wall time of the window, s: computing, or waiting for a remote reply; nan in a recording."""

    @property
    def step_series(self) -> StepSeries | None:
        """Values of every step; None unless requested with `record_steps=True`."""

@final
class BodyResult:
    """Action of the ballast on a driven body during a window, about its reference point, world axes."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, bytes]]: ...
    @property
    def impulse(self) -> _Floats:
        """Impulse of the ballast on the body over the window (3,), N s."""

    @property
    def angular_impulse(self) -> _Floats:
        """Angular impulse of the ballast on the body over the window (3,), N m s."""

    @property
    def mean_force(self) -> _Floats:
        """Mean force over the window (3,), N: the impulse divided by the length of the window."""

    @property
    def mean_torque(self) -> _Floats:
        """Mean torque over the window (3,), N m."""

    @property
    def moving_average_force(self) -> _Floats:
        """Mean force over the last 4 ms in whole steps, at least one (3,), N; may include steps before the window."""

    @property
    def moving_average_torque(self) -> _Floats:
        """Mean torque over the last 4 ms in whole steps, at least one (3,), N m; may include steps before the window."""

    @property
    def peak_force(self) -> _Floats:
        """Largest mean force of a single step (3,), N."""

    @property
    def peak_torque(self) -> _Floats:
        """Mean torque of the step with the peak force (3,), N m."""

    @property
    def peak_time_ns(self) -> int:
        """End of the step with the peak force, ns since the start of the run; the window's start if no force acted."""

    @property
    def work(self) -> float:
        """Work of the body on the ballast, J."""

    @property
    def contacts(self) -> int:
        """Number of contact points with an impulse in the last step."""

    @property
    def position(self) -> _Floats:
        """Position at the end of the window (3,), m."""

    @property
    def orientation(self) -> _Floats:
        """Orientation at the end of the window (4,), x, y, z, w."""

    @property
    def velocity(self) -> _Floats:
        """Velocity at the end of the window (3,), m/s."""

    @property
    def angular_velocity(self) -> _Floats:
        """Angular velocity at the end of the window (3,), rad/s."""

@final
class ZoneResult:
    """Measurements of a zone at the end of a window; values that cannot be measured are None."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, bytes]]: ...
    @property
    def low(self) -> _Floats:
        """Lowest corner of the zone (3,), m."""

    @property
    def high(self) -> _Floats:
        """Highest corner of the zone (3,), m."""

    @property
    def compactness(self) -> float | None:
        """Compactness: solid volume divided by accessible volume, 0 to 1."""

    @property
    def coordination(self) -> float | None:
        """Mean number of touching neighbours per grain."""

    @property
    def inertial_number(self) -> float | None:
        """Inertial number of the granular flow (T-22), dimensionless."""

    @property
    def pressure(self) -> float:
        """Mean pressure in the last step, Pa."""

@final
class Squeeze:
    """Squeeze of a pair of facing tines, measured up to the last complete vibration period."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, bytes]]: ...
    @property
    def number(self) -> int:
        """Number of the squeeze for its pair, from 1."""

    @property
    def is_finished(self) -> bool:
        """True when the pair has opened again."""

    @property
    def start_ns(self) -> int:
        """Time of the pair's widest opening, ns since the start of the run; closings are measured from there."""

    @property
    def onset_ns(self) -> int | None:
        """Time at which ballast resistance starts: end of the first vibration period with sustained force, ns; `None` before."""

    @property
    def closing(self) -> float:
        """Closing of one side, averaged over the last vibration period, m."""

    @property
    def peak_force(self) -> float:
        """Largest force of one side, averaged over a vibration period, N."""

    @property
    def peak_step_force(self) -> float:
        """Largest force of one side in a single step, N."""

    @property
    def work(self) -> float:
        """Work of both tines on the ballast after the first 2 mm of closing, including vibration, J."""

    @property
    def compaction_energy(self) -> float:
        """Work of the period-averaged force along the largest closing, both sides, J."""

    @property
    def loop(self) -> _Floats:
        """Force-displacement loop (n, 2): closing (m) and period-averaged force (N) of one side."""

@final
class SolverResult:
    """Result of the contact solver in a window."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, bytes]]: ...
    @property
    def iterations(self) -> int:
        """Number of iterations over all steps."""

    @property
    def visits(self) -> int:
        """Number of local contact solves over all steps."""

    @property
    def steps_not_converged(self) -> int:
        """Number of steps that stopped at their iteration cap above the tolerance; 0 without a tolerance."""

    @property
    def residual_qm16(self) -> float:
        """Largest QM/16 residual of a step, dimensionless."""

    @property
    def residual_natural_map(self) -> float:
        """Largest natural-map residual of a step, dimensionless."""

    @property
    def contacts(self) -> int:
        """Number of contacts in the last step."""

    @property
    def active_contacts(self) -> int:
        """Number of active contacts in the last step."""

    @property
    def mean_penetration(self) -> float:
        """Mean penetration in the last step, m."""

    @property
    def max_penetration(self) -> float:
        """Largest penetration of all steps, m."""

    @property
    def force_difference(self) -> float:
        """Differences of the impulses on tines and sleepers between two solutions of the checked steps, N s."""

    @property
    def force_compared(self) -> float:
        """Magnitudes of these impulses, N s; 0 where no step of the window was checked."""

    @property
    def force_error(self) -> float | None:
        """Relative difference of the forces on tines and sleepers between two solutions of the checked steps.

        A checked step is solved from the impulses of the last step and from zero. None where no step was checked.
        """

    @property
    def complementarity_gap(self) -> float:
        """Energy by which impulses on opening contacts and friction miss the contact law, all steps, J (T-44)."""

    @property
    def infeasible_work(self) -> float:
        """Energy of contacts that still close where the solve of a step ends, all steps, J (T-44)."""

    @property
    def dissipated(self) -> float:
        """Energy that contacts have dissipated in the window, J."""

    @property
    def complementarity_error(self) -> float | None:
        """Complementarity gap and infeasible part over the dissipated energy of the window.

        Zero if all steps are solved exactly; None where nothing was dissipated.
        """

@final
class EnergyLedger:
    """Energies of the grains since the start of the run, J."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[str, bytes]]: ...
    @property
    def initial_kinetic(self) -> float:
        """Kinetic energy at the start of the run, J."""

    @property
    def initial_potential(self) -> float:
        """Potential energy at the start of the run, J."""

    @property
    def initial_elastic(self) -> float:
        """Energy of the contacts' springs at the start of the run, J."""

    @property
    def kinetic(self) -> float:
        """Current kinetic energy, J."""

    @property
    def potential(self) -> float:
        """Current potential energy, J."""

    @property
    def elastic(self) -> float:
        """Current energy of the contacts' springs, J."""

    @property
    def external_work(self) -> float:
        """Work of the driven bodies on the grains, J."""

    @property
    def dissipated(self) -> float:
        """Energy dissipated by friction and impacts, J."""

    @property
    def balance_error(self) -> float:
        """Energy that the ledger cannot account for, J."""

@final
class StepSeries:
    """Values of every step of a window."""

    def __len__(self) -> int: ...
    def __reduce__(self) -> tuple[Callable[..., StepSeries], tuple[bytes, list[str]]]: ...
    @property
    def time_ns(self) -> NDArray[np.uint64]:
        """End of each step (n,), ns since the start of the run."""

    @property
    def iterations(self) -> NDArray[np.uint32]:
        """Number of iterations of each step (n,)."""

    @property
    def residual_qm16(self) -> _Floats:
        """QM/16 residual at the end of each step (n,), dimensionless."""

    @property
    def impulses(self) -> dict[str, _Floats]:
        """Impulse (N s) and angular impulse (N m s) of each step by driven body (n, 6)."""

@final
class Results:
    """Results file of a run (`.vtkhdf`).

    Raises:
        FileError: the file cannot be read.
    """

    def __new__(cls, path: _Path) -> Results: ...
    def poses(self, frame: SupportsIndex) -> tuple[_Floats, _Floats]:
        """Returns positions (n, 3) in m and orientations (n, 4) of all bodies in a frame: grains, then driven bodies.

        Raises:
            IndexError: the file has no such frame.
        """

    def table(self, name: str) -> dict[str, NDArray[Any]]:
        """Returns the columns of a table by name, and `step`; `units` has their units.

        Raises:
            KeyError: the file has no such table.
        """

    def units(self, name: str) -> dict[str, str]:
        """Returns the units of the columns of a table by name.

        Raises:
            KeyError: the file has no such table.
        """

    @property
    def case_name(self) -> str:
        """Name of the case."""

    @property
    def case_text(self) -> str:
        """Text of the case file (TOML)."""

    @property
    def grain_count(self) -> int:
        """Number of grains, ng."""

    @property
    def bodies(self) -> list[str]:
        """Names of the driven bodies, in the order of `poses` after the grains."""

    @property
    def roles(self) -> dict[str, str]:
        """Role of each driven body by name: "boundary", "plate", "sleeper" or "tine"."""

    @property
    def is_closed(self) -> bool:
        """True if the run has ended and closed the file; false while it is running, or if it was killed."""

    @property
    def steps(self) -> NDArray[np.uint64]:
        """Step number of each frame (n,)."""

    @property
    def times(self) -> _Floats:
        """Time of each frame (n,), s."""

    @property
    def tables(self) -> list[str]:
        """Names of the tables."""

@final
class Recording:
    """Recording of a run (MCAP): an iterator over its windows.

    Each window is a dictionary:

    * `seq`, `t0_ns`, `t1_ns`: number, start and end of the window, ns.
    * `request`: the request as a message; `motions` and `loads`: its inputs by body, as arguments for `advance_to`.
    * `parameters`: arguments for `set_parameters` that were set before the window; empty if none were.
    * `result`: the `WindowResult`, except for values that are not recorded: `wall_time_s` is nan,
      `max_knot_spacing_ns` is 0, `step_series` is None, and a window that ended early has the status "ok" or "warn".
    * `hash`, `reply_digest`: hashes of the state after the window and of the reply.

    An incomplete file yields its valid windows first. Then the iterator issues a RuntimeWarning once if the file is cut
    short, as after a kill, or raises FileError once if it is damaged. See `truncation`.

    Raises:
        FileError: the file cannot be read.
    """

    def __new__(cls, path: _Path) -> Recording: ...
    def __iter__(self) -> Recording: ...
    def __next__(self) -> dict[str, Any]: ...
    @property
    def case(self) -> Case:
        """Recorded case, with its seed and schedule."""

    @property
    def start(self) -> State | None:
        """State at the start of the recording; None if it is the start of the case."""

    @property
    def truncation(self) -> str | None:
        """Reason why reading ended before the end of the recording, or None."""

def _attach(
    component: str, connect: Sequence[str] | None, listen: Sequence[str] | None, config: _Path | None
) -> Simulation: ...
def _open(
    case: Case,
    bed_cache: _Path,
    threads: int | None = None,
    progress: Callable[[float, str], object] | None = None,
    max_penetration: float | None = None,
    keep_partial_window: bool = False,
) -> Simulation: ...
def _prepare(
    case: Case,
    bed_cache: _Path,
    threads: int | None = None,
    progress: Callable[[float, str], object] | None = None,
    rebuild: bool = False,
) -> os.PathLike[str]: ...
def _resume(
    state: State,
    threads: int | None = None,
    max_penetration: float | None = None,
    keep_partial_window: bool = False,
) -> Simulation: ...
def _replace_file(path: _Path, text: str) -> None: ...
def _parse_toml(text: str) -> dict[str, Any]: ...
def _write_sweep_plan(case: str, points: Sequence[Mapping[str, Any]], path: _Path) -> None: ...
def _unpickle_case(text: str, seed: int | None, schedule: str | None) -> Case: ...
def _unpickle_state(bytes: bytes) -> State: ...
def _unpickle_remote_state(reference: object) -> State: ...
def _unpickle_part(kind: str, bytes: bytes) -> Any: ...
def _unpickle_step_series(bytes: bytes, names: Sequence[str]) -> StepSeries: ...
def _unpickle_window_result(
    bytes: bytes, names: Sequence[str], wall_time_s: float, has_step_series: bool
) -> WindowResult: ...
def schema() -> dict[str, Any]:
    """Returns the JSON Schema of case files."""

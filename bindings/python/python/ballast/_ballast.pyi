"""The compiled part of `ballast`. SI units; world axes, z up; quaternions x, y, z, w; times in ns."""

import os
from collections.abc import Callable, ItemsView, Iterator, KeysView, Mapping, Sequence, ValuesView
from typing import Any, SupportsIndex, TypeVar, final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Path = str | os.PathLike[str]
_Floats = NDArray[np.float64]
_Times = Sequence[SupportsIndex] | NDArray[np.integer[Any]]
_Else = TypeVar("_Else")

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
    "attach",
    "begin",
    "case_again",
    "prepare",
    "replace",
    "resume",
    "schema",
    "state_again",
    "values",
    "write_plan",
]
__version__: str

class Error(Exception):
    """Anything that goes wrong in Ballast; `code` names it."""

    code: str

class CaseError(Error):
    """A case that describes no run; `diagnostics` lists every fault with its line."""

    diagnostics: tuple[dict[str, Any], ...]

class Refused(Error):
    """A request that makes no sense; nothing has changed.

    `code`: time_grid, input_gap, input_jump, input_invalid, unknown_body, nothing_to_redo,
    state_invalid, parameter_invalid, recording; elsewhere: only a simulation of this process can do it. A
    component that another process computes also refuses with busy, unknown_state, too_many_states and other codes
    of its control plane.
    """

    place: str | None
    """Where the message has parts: a field, or the body whose input it is."""
    expected: str | None
    found: str | None
    nearest_ns: tuple[int, int] | None
    """For time_grid: the times next to it at which a window may end."""

class Unreachable(Error):
    """A component that another process computes has not answered as it should. The same call may be made again:
    a window counts once, however often it is asked for. Only after `diverged` nothing but `restore` goes on.

    `code`: name, it cannot be one; slow, it is there; peer_lost, it is not; diverged, its run went on without this
    simulation; link, how to reach it; answer, what it says cannot be read; abandoned, `stop` or `close` has ended the wait.
    """

class FileError(Error):
    """A file that cannot be read or written."""

class Lost(Error):
    """The program failed inside, and the simulation with it. `restore` of a saved state goes on."""

@final
class Case:
    """A case that was read and found sound.

    `Case(text)` reads it from its text (TOML); `name` stands for it in messages. Raises CaseError. Cases that were read
    from the same text and have the same seed and schedule are equal; they can be copied and pickled."""

    def __new__(cls, text: str, name: str = "case") -> Case: ...
    @staticmethod
    def load(path: _Path) -> Case:
        """Reads a case file. Raises CaseError with every fault and its line, FileError."""

    @staticmethod
    def from_dict(values: dict[str, Any]) -> Case:
        """A case from nested dictionaries. Raises CaseError."""

    def to_dict(self) -> dict[str, Any]:
        """The text's values as nested dictionaries; what the text leaves to defaults is not in them."""

    def write(self, path: _Path) -> None:
        """Writes the case's text to a file. Of what lies there only a text in TOML is replaced. Raises FileError."""

    def with_values(self, values: dict[str, Any]) -> Case:
        """The same case with other values: paths of keys joined by points, and what they become, such as
        `{"tamping.vibration.frequency_Hz": 40.0}`. Raises CaseError."""

    def choose(self, *, seed: SupportsIndex | None = None, schedule: str | None = None) -> Case:
        """The same case with another seed of the bed, or another schedule of the solver."""

    @property
    def name(self) -> str:
        """As the case calls itself."""

    @property
    def text(self) -> str:
        """TOML, as it was read; where `choose` has changed the seed or the schedule, with these. Raises CaseError where
        TOML cannot hold the seed (above 2^63 - 1)."""

    @property
    def seed(self) -> int:
        """Of the bed: the case's, or that of `choose`."""

    @property
    def schedule(self) -> str:
        """Of the solver: "sequential", "synchronous" or "asynchronous"."""

    @property
    def step_ns(self) -> int:
        """Length of a step, ns."""

    @property
    def duration_ns(self) -> int:
        """Length of the run that the case describes, ns."""

    @property
    def warnings(self) -> list[str]:
        """What is allowed but looks like a slip."""

    @property
    def bed_key(self) -> str:
        """What the prepared bed depends on, as a short text."""

    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...
    def __reduce__(self) -> tuple[Callable[..., Case], tuple[str, int | None, str | None]]: ...

@final
class Motion:
    """Motion of a driven body, or of the mount of one, through a window.

    Knots of a motion; nothing is extrapolated beyond them.

    Args:
        times_ns: (n,) in order, from the window's start or before to its end or later.
        positions: (n, 3) of the body's reference point, m.
        orientations: (n, 4) unit quaternions x, y, z, w; upright unless given.
        velocities: (n, 3) of the reference point, m/s.
        spins: (n, 3) rad/s, world axes; needed with hermite where orientations differ, else 0 unless given.
        interpolation: "hermite" (cubic through poses and velocities; the default where velocities are
            given), "linear" (the default without them) or "hold".
        rebase: the motion need not begin where the body is.
    """

    def __new__(
        cls,
        times_ns: _Times,
        positions: ArrayLike,
        orientations: ArrayLike | None = None,
        *,
        velocities: ArrayLike | None = None,
        spins: ArrayLike | None = None,
        interpolation: str | None = None,
        rebase: bool = False,
    ) -> Motion: ...
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Pickled and copied as what it was made of."""

@final
class Load:
    """Load on a mounted body through a window, beside its weight along directions that are loaded; along sprung ones the
    spring carries that already.

    Knots of forces (n, 3) in N and torques (n, 3) about the reference point in N m, linear between them or held from each
    one on; `times_ns` (n,) are in order."""

    def __new__(
        cls,
        times_ns: _Times,
        forces: ArrayLike,
        torques: ArrayLike | None = None,
        *,
        held: bool = False,
    ) -> Load: ...
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]:
        """Pickled and copied as what it was made of."""

@final
class Simulation:
    """A model that is stepped in windows: of `ballast.open` and `ballast.resume`.

    Computing releases the interpreter; Ctrl-C ends a window within a step, which is then not done, in a valid state:
    `last` tells what it has come to. Python tells Ctrl-C to its main thread alone: a window of another thread ends by
    `stop` or `close`, and so with `with`. One that another process computes (`ballast.open("zenoh:SITE/ID")`) goes on
    there: the same call made again gives its outcome, any other one waits for its end first. Of that one, `advance_to`,
    `redo`, `last`, `save`, `restore`, `set_parameters`, `stop`, `close` and what says of itself here are there; the rest
    is refused with the code "elsewhere".
    Only one thread at a time may step a simulation (another one gets `Error` with the code "busy");
    simulations of their own run side by side.
    """

    def __enter__(self) -> Simulation: ...
    def __exit__(self, *error: object) -> None: ...
    def advance_to(
        self,
        t1_ns: SupportsIndex,
        tools: Mapping[str, Motion] | None = None,
        loads: Mapping[str, Load] | None = None,
        *,
        series: bool = False,
        zones: bool = False,
    ) -> Outcome:
        """Advances to `t1_ns`, a whole number of steps from now.

        Args:
            t1_ns: end of the window, ns since the start of the run.
            tools: motions of driven bodies by name; the others stay where they are. One that a cubic motion has left
                moving needs another one: that goes on so, or has `rebase`.
            loads: loads on mounted bodies by name; the others have none.
            series: keep the impulses of every step, see `Outcome.series`.
            zones: measure the case's zones at the end, see `Outcome.zones`; it takes longer than a coupling's
                own work, so it is not done unasked.

        Raises:
            Refused: the request makes no sense; nothing has changed.
            Lost: the program failed inside.
        """

    def redo(
        self,
        tools: Mapping[str, Motion] | None = None,
        loads: Mapping[str, Load] | None = None,
        *,
        series: bool = False,
        zones: bool = False,
    ) -> Outcome:
        """Computes the last window again from its beginning, with other inputs: for implicit coupling. It is computed as it was
        asked for, also where Ctrl-C, `stop` or trouble (status "early") had ended it before its end."""

    def step_by_machine(self, *, series: bool = False, zones: bool = False) -> Outcome:
        """A window of one step, in which the machine of the case moves tines and sleepers, as `ballast run`
        does: with the force limits of the case, from what it remembers of its own steps."""

    def stop(self) -> None:
        """Ends the window that another thread is computing, within a step, which is then not done: its outcome has the
        code "stopped" and the status "early", or "discard" where it was the first step. One that another process
        computes goes on there, and its caller gets `Unreachable` with the code "abandoned". Windows that are begun later
        are not ended."""

    def save(self) -> State:
        """Everything that the next window depends on; shared, not copied."""

    def restore(self, state: State) -> None:
        """Goes back, or on, to a saved state of the same case."""

    def set_parameters(
        self, *, iterations: int | None = None, tolerance: float | None = None, max_penetration: float | None = None
    ) -> None:
        """Sets how steps are solved from now on, also in a redo of the last window; what is not given stays.

        Args:
            iterations: most iterations of a step, at least 1.
            tolerance: a step is solved when its residual is below; 0: always all iterations.
            max_penetration: how deep a step may press bodies into each other, m, before its window is taken back;
                infinite: any.

        Raises:
            Refused: a number that makes no sense; nothing has changed.
        """

    def fork(self) -> Simulation:
        """Another simulation that goes on from here on its own."""

    def record(self, path: _Path) -> None:
        """Records the windows from now on in an MCAP file, which is replaced. Where the file cannot be written any
        more, a RuntimeWarning says so, and the simulation goes on unrecorded."""

    def stop_recording(self) -> None:
        """Ends the recording, if there is one. Raises FileError, also where its file could not be written to the end."""

    def close(self) -> None:
        """Ends the simulation, and its recording as `stop_recording` does; states and arrays that it gave away stay. A window
        that another thread is computing is ended as by `stop`, and waited for."""

    def zones(self) -> dict[str, ZoneOutcome]:
        """The case's zones, measured now."""

    def shape(self, index: SupportsIndex) -> tuple[_Floats, list[list[int]]]:
        """Corners (n, 3) of a shape in its own frame, m, and its faces as numbers of corners,
        counter-clockwise from outside."""

    def parts(self, name: str) -> list[tuple[_Floats, list[list[int]]]]:
        """The solids that a driven body is made of, each as corners (n, 3) in the body's frame, m, and faces as those of
        `shape`. A wall without end has none."""

    @property
    def last(self) -> Outcome | None:
        """The outcome of the last window as far as it was computed, also where Ctrl-C or another exception came instead of
        it; None before the first window and after `restore`."""

    @property
    def case(self) -> Case:
        """What it is a simulation of."""

    @property
    def now_ns(self) -> int:
        """Simulated time, ns since the start of the run."""

    @property
    def step_ns(self) -> int:
        """Length of a step, ns."""

    @property
    def schedule(self) -> str:
        """Of the solver: "sequential", "synchronous" or "asynchronous"."""

    @property
    def threads(self) -> int:
        """How many threads compute, the calling one among them."""

    @property
    def bodies(self) -> list[str]:
        """Names of the driven bodies: tines, boundaries, sleepers."""

    @property
    def roles(self) -> dict[str, str]:
        """What each driven body is, by name: "boundary", "sleeper" or "tine"."""

    @property
    def mounts(self) -> dict[str, Mount]:
        """What holds the driven bodies that loads can move, by name. The motion of the others is imposed."""

    @property
    def tines(self) -> list[Tine]:
        """The ways of the tines through the case's tamping cycle; none without tamping."""

    @property
    def phase(self) -> str:
        """Of the case's tamping cycle at this time: waiting, lift, insertion, squeeze, hold, withdrawal
        or done."""

    @property
    def grains(self) -> int:
        """Number of grains."""

    @property
    def shape_of(self) -> NDArray[np.uint32]:
        """(ng,) which shape each grain has."""

    @property
    def masses(self) -> _Floats:
        """(ng,) kg."""

    @property
    def is_lost(self) -> bool:
        """Whether the program failed inside; `restore` of a saved state goes on."""

    @property
    def is_closed(self) -> bool:
        """Whether `close` was called."""

    def _fail_next(self) -> None: ...

@final
class Mount:
    """What holds a body that loads can move: by direction, the motion that is asked of the body, springs that follow it, or
    nothing."""

    @property
    def mass(self) -> float:
        """That moves with the body, kg."""

    @property
    def freedoms(self) -> tuple[str, str, str, str, str, str]:
        """Of x, y, z, and of the rotations about them: "prescribed", "spring" or "free"."""

    @property
    def stiffness(self) -> _Floats:
        """(6,) where it is sprung, in the same order: N/m, of rotations N m/rad; elsewhere 0."""

    @property
    def damping(self) -> _Floats:
        """(6,) where it is sprung, in the same order: N s/m, of rotations N m s/rad; elsewhere 0."""

@final
class Tine:
    """The way of a tine through the tamping cycle of its case."""

    @property
    def name(self) -> str:
        """Its body's."""

    @property
    def pair(self) -> int:
        """Number of its pair in the case: its squeezes are those of "pair_NUMBER"."""

    @property
    def direction(self) -> float:
        """Of its squeeze along x: 1 or -1."""

    @property
    def start(self) -> _Floats:
        """(3,) where its reference point is before the cycle, m."""

    @property
    def deep(self) -> float:
        """Height of its reference point at full depth, m."""

    @property
    def stroke(self) -> float:
        """How far it closes, m."""

@final
class State:
    """A state that was saved. Arrays are read-only and not copied; they keep their values while the
    simulation goes on, and stay valid as long as somebody holds them. It can be copied, which takes nothing, and pickled.

    A state of a simulation that another process computes is kept there until nobody here holds it any more: it has
    `time_ns`, `hash`, `target` and `target_twist`, `restore` takes it, and it cannot be pickled."""

    @staticmethod
    def read(path: _Path) -> State:
        """Reads what `write` has written, or a checkpoint of `ballast run`. Raises FileError."""

    def write(self, path: _Path) -> None:
        """Writes the state to a file from which it goes on to the same bytes, also in another process. Of what lies there
        only such a file, a bed or a checkpoint is replaced. Raises FileError."""

    def __reduce__(self) -> tuple[Callable[..., State], tuple[bytes]]:
        """Pickled as the bytes of the file that `write` would leave."""

    def __copy__(self) -> State:
        """Nothing changes a state."""

    def __deepcopy__(self, _memo: object) -> State: ...
    def body(self, name: str) -> tuple[_Floats, _Floats, _Floats, _Floats]:
        """Position (m), orientation (x, y, z, w), velocity (m/s) and spin (rad/s) of a driven body."""

    def target(self, name: str) -> tuple[_Floats, _Floats]:
        """Position (m) and orientation (x, y, z, w) that were last asked of a driven body, or of the mount that
        holds it: where its next motion has to begin."""

    def target_twist(self, name: str) -> tuple[_Floats, _Floats] | None:
        """Velocity (m/s) and spin (rad/s) with which the next cubic motion of a driven body, or of the mount that holds
        it, begins: as the last one ended, or zero where the body had no motion. None, any, after a held or linear one."""

    @property
    def time_ns(self) -> int:
        """Simulated time, ns since the start of the run."""

    @property
    def step(self) -> int:
        """Steps since the start of the run."""

    @property
    def hash(self) -> str:
        """128 bits that tell states apart, as 32 hexadecimal digits: `ballast serve` has the same, and so have recordings
        of either. `ballast run`, which remembers its machine instead of windows, has others of the same bodies, in its
        files and recordings, too."""

    @property
    def positions(self) -> _Floats:
        """(ng, 3) of the grains, m."""

    @property
    def orientations(self) -> _Floats:
        """(ng, 4) of the grains, x, y, z, w."""

    @property
    def velocities(self) -> _Floats:
        """(ng, 3) of the grains, m/s."""

    @property
    def spins(self) -> _Floats:
        """(ng, 3) of the grains, rad/s."""

    @property
    def contact_bodies(self) -> NDArray[np.uint32]:
        """(nc, 2) bodies of each contact point; driven bodies are numbered after the grains."""

    @property
    def contact_impulses(self) -> _Floats:
        """(nc, 3) impulse of the last step on the first body, N s."""

    @property
    def contact_points(self) -> _Floats:
        """(nc, 3) where the contacts are, m; a copy."""

@final
class Outcome:
    """The result of a window, a mapping: `outcome[name]` is what the ballast did to a body."""

    def __iter__(self) -> Iterator[str]: ...
    def __len__(self) -> int: ...
    def __getitem__(self, name: str, /) -> BodyOutcome: ...
    def __contains__(self, name: object, /) -> bool: ...
    @overload
    def get(self, name: str, default: None = None) -> BodyOutcome | None:
        """What the ballast did to a body, or `default` where there is none of this name."""

    @overload
    def get(self, name: str, default: _Else) -> BodyOutcome | _Else:
        """What the ballast did to a body, or `default` where there is none of this name."""

    def keys(self) -> KeysView[str]:
        """Names of the bodies, as those of `bodies`."""

    def values(self) -> ValuesView[BodyOutcome]:
        """What the ballast did to each, as those of `bodies`."""

    def items(self) -> ItemsView[str, BodyOutcome]:
        """Both, as those of `bodies`."""

    @property
    def status(self) -> str:
        """"ok"; "warn": a step stopped at its cap of iterations; "early": ended before its end, in a valid
        state; "discard": nothing was kept."""

    @property
    def code(self) -> str | None:
        """What ended the window, for programs: "over_speed", "penetration", "not_finite", "step_failed", or "stopped": by
        `stop`, `close` or Ctrl-C."""

    @property
    def trouble(self) -> str | None:
        """What ended the window, where something did."""

    @property
    def t0_ns(self) -> int:
        """Where it began, ns since the start of the run."""

    @property
    def t1_ns(self) -> int:
        """As far as it was computed, ns."""

    @property
    def steps(self) -> int:
        """How many were computed."""

    @property
    def bodies(self) -> dict[str, BodyOutcome]:
        """What the ballast did to each driven body, by name."""

    @property
    def zones(self) -> dict[str, ZoneOutcome]:
        """At the end of the window, where `zones=True` asked for them."""

    @property
    def squeezes(self) -> dict[str, Squeeze]:
        """Squeezes that were in progress, by pair of tines ("pair_0"); of two of a pair the later one. How they are told
        apart: docs/src/coupling/concepts.md."""

    @property
    def solver(self) -> SolverOutcome:
        """How it was solved."""

    @property
    def energy(self) -> EnergyLedger:
        """Since the start of the run."""

    @property
    def hint_max_step_ns(self) -> int:
        """How far apart knots may be for no body to move too far between them at its speed now, ns;
        0 where nothing moves, and of a recording."""

    @property
    def wall_s(self) -> float:
        """How long the window took to compute, s of wall time; elsewhere: until it was answered; nan of a recording."""

    @property
    def series(self) -> Series | None:
        """Step by step, where `series=True` asked for it."""

@final
class BodyOutcome:
    """What the ballast did to a driven body during a window, about its reference point."""

    @property
    def impulse(self) -> _Floats:
        """(3,) over the window, N s."""

    @property
    def angular_impulse(self) -> _Floats:
        """(3,) over the window, N m s."""

    @property
    def mean_force(self) -> _Floats:
        """(3,) impulse over the length of the window, N."""

    @property
    def mean_torque(self) -> _Floats:
        """(3,) angular impulse over the length of the window, N m."""

    @property
    def moving_force(self) -> _Floats:
        """(3,) mean over as many whole steps as 4 ms hold, one at least; may have begun before the window, N."""

    @property
    def moving_torque(self) -> _Floats:
        """(3,) mean over the same steps, N m."""

    @property
    def peak_force(self) -> _Floats:
        """(3,) largest mean force of a step, N."""

    @property
    def peak_torque(self) -> _Floats:
        """(3,) mean torque of that step, N m."""

    @property
    def peak_time_ns(self) -> int:
        """End of that step, ns since the start of the run; the beginning of the window where no force acted."""

    @property
    def work(self) -> float:
        """Of the body on the ballast, J."""

    @property
    def contacts(self) -> int:
        """Contact points that carried an impulse in the last step."""

    @property
    def position(self) -> _Floats:
        """(3,) at the end of the window, m."""

    @property
    def orientation(self) -> _Floats:
        """(4,) at the end of the window, x, y, z, w."""

    @property
    def velocity(self) -> _Floats:
        """(3,) at the end of the window, m/s."""

    @property
    def spin(self) -> _Floats:
        """(3,) at the end of the window, rad/s."""

@final
class ZoneOutcome:
    """A zone at the end of a window; what cannot be measured there is None."""

    @property
    def low(self) -> _Floats:
        """(3,) lowest corner, m."""

    @property
    def high(self) -> _Floats:
        """(3,) highest corner, m."""

    @property
    def compactness(self) -> float | None:
        """Solid over accessible volume, 0 to 1."""

    @property
    def coordination(self) -> float | None:
        """Mean number of touching neighbours."""

    @property
    def inertial_number(self) -> float | None:
        """How fast it flows for its pressure and size of grains (T-22), without unit."""

    @property
    def pressure(self) -> float:
        """Mean over the last step, Pa."""

@final
class Squeeze:
    """What a pair of facing tines has done in a squeeze, up to the last whole vibration period."""

    @property
    def number(self) -> int:
        """Of the pair, from 1 on."""

    @property
    def is_over(self) -> bool:
        """The pair has opened again."""

    @property
    def began_ns(self) -> int:
        """When the pair was at its widest, ns; closings are counted from there."""

    @property
    def onset_ns(self) -> int | None:
        """End of the period since which the ballast resists, or did so last, ns."""

    @property
    def closing(self) -> float:
        """Of a side, mean over the last period, m."""

    @property
    def peak_force(self) -> float:
        """Largest mean force of a side over a period, N."""

    @property
    def peak_step_force(self) -> float:
        """Largest force of a single step, N."""

    @property
    def work(self) -> float:
        """Of the pair's tines on the ballast since it had closed by 2 mm, vibration included, J."""

    @property
    def compaction_energy(self) -> float:
        """Work of the mean force along the closing as far as it came, both sides, J."""

    @property
    def loop(self) -> _Floats:
        """(n, 2) closing (m) and mean force (N) of a side, one row per period or per few of them."""

@final
class SolverOutcome:
    """How a window was solved."""

    @property
    def iterations(self) -> int:
        """Over all steps."""

    @property
    def visits(self) -> int:
        """Of contacts, over all steps."""

    @property
    def steps_not_converged(self) -> int:
        """Steps that stopped at their cap of iterations above the tolerance; 0 where none is asked for."""

    @property
    def residual_qm16(self) -> float:
        """Largest of a step, without unit."""

    @property
    def residual_natural_map(self) -> float:
        """Largest of a step, without unit."""

    @property
    def contacts(self) -> int:
        """In the last step."""

    @property
    def active_contacts(self) -> int:
        """Those that carry, in the last step."""

    @property
    def mean_penetration(self) -> float:
        """Of the last step, m."""

    @property
    def max_penetration(self) -> float:
        """Largest of all steps, m."""

@final
class EnergyLedger:
    """Energies of the grains since the start of the run, J."""

    @property
    def initial_kinetic(self) -> float:
        """At the start of the run, J."""

    @property
    def initial_potential(self) -> float:
        """At the start of the run, J."""

    @property
    def kinetic(self) -> float:
        """Now, J."""

    @property
    def potential(self) -> float:
        """Now, J."""

    @property
    def work_in(self) -> float:
        """Work of driven bodies on the grains, J."""

    @property
    def dissipated(self) -> float:
        """By friction and in impacts, J."""

    @property
    def balance_error(self) -> float:
        """What the ledger cannot account for, J."""

@final
class Series:
    """A window step by step."""

    def __len__(self) -> int: ...
    @property
    def time_ns(self) -> NDArray[np.uint64]:
        """(n,) end of each step, ns."""

    @property
    def iterations(self) -> NDArray[np.uint32]:
        """(n,) of each step."""

    @property
    def residual_qm16(self) -> _Floats:
        """(n,) at the end of each step, without unit."""

    @property
    def impulses(self) -> dict[str, _Floats]:
        """(n, 6) per body: impulse (N s) and angular impulse (N m s) of each step."""

@final
class Results:
    """A results file of `ballast run`."""

    def __new__(cls, path: _Path) -> Results: ...
    def poses(self, frame: SupportsIndex) -> tuple[_Floats, _Floats]:
        """Positions (n, 3) in m and orientations (n, 4) of all bodies in a frame, grains first."""

    def table(self, name: str) -> dict[str, NDArray[Any]]:
        """Columns of a table by name, and `step`; units in `units(name)`."""

    def units(self, name: str) -> dict[str, str]:
        """Units of the columns of a table, by name."""

    @property
    def case_name(self) -> str:
        """As the case calls itself."""

    @property
    def case_text(self) -> str:
        """Of the case file, TOML."""

    @property
    def bodies(self) -> tuple[int, list[str]]:
        """Number of grains, and names of the driven bodies after them."""

    @property
    def roles(self) -> list[str]:
        """What each of the driven bodies is: "boundary", "sleeper" or "tine"."""

    @property
    def is_closed(self) -> bool:
        """Whether the run has closed its results, at its end or where it was told to stop; not while it is going on, nor
        where it was killed."""

    @property
    def steps(self) -> NDArray[np.uint64]:
        """(n,) step of each frame."""

    @property
    def times(self) -> _Floats:
        """(n,) time of each frame, s."""

    @property
    def tables(self) -> list[str]:
        """Names of the tables."""

@final
class Recording:
    """A recording (MCAP): an iterator over its windows, each a dictionary with `seq`, `t0_ns`, `t1_ns`, what was asked
    (`request`), also as motions and loads by the names of their bodies (`tools`, `loads`) to be asked again, the
    `parameters` that were set before (empty where none were), what the window did (`outcome`), and the `hash` of the state
    and the `reply_digest` that it led to.

    Such an outcome is what `advance_to` gave, but for what is not recorded: `wall_s` is nan, `hint_max_step_ns` is 0,
    there is no `series`, and one that was ended early is as "ok", or "warn", as the shorter window that it was.

    Of a file that does not go on to its end the iterator gives what is sound. At the end of that it gives a
    RuntimeWarning, once, where the file is cut short, as after a kill, and raises FileError, once, where it is
    damaged. `lost` says it, too."""

    def __new__(cls, path: _Path) -> Recording: ...
    def __iter__(self) -> Recording: ...
    def __next__(self) -> dict[str, Any]: ...
    @property
    def case(self) -> Case:
        """What it is a recording of, with the seed and the schedule that were chosen."""

    @property
    def start(self) -> State | None:
        """The state that it begins with; None where that is the beginning of its case."""

    @property
    def lost(self) -> str | None:
        """Why reading ended early, where it did."""

def attach(
    component: str, connect: Sequence[str] | None, listen: Sequence[str] | None, config: _Path | None
) -> Simulation: ...
def begin(
    case: Case,
    beds: _Path,
    threads: int | None = None,
    progress: Callable[[float, str], object] | None = None,
    max_penetration: float | None = None,
    keep_early: bool = False,
) -> Simulation: ...
def case_again(text: str, seed: int | None, schedule: str | None) -> Case:
    """A case that was copied or pickled."""

def prepare(
    case: Case,
    beds: _Path,
    threads: int | None = None,
    progress: Callable[[float, str], object] | None = None,
    again: bool = False,
) -> os.PathLike[str]: ...
def replace(path: _Path, text: str) -> None:
    """Replaces a file by a text, at once or not at all."""
def resume(
    state: State,
    threads: int | None = None,
    max_penetration: float | None = None,
    keep_early: bool = False,
) -> Simulation: ...
def schema() -> dict[str, Any]:
    """The JSON Schema of case files."""

def state_again(bytes: bytes) -> State:
    """A state that was pickled."""
def values(text: str) -> dict[str, Any]:
    """The values of a text in TOML as nested dictionaries.

    Written anew before Python reads it: `tomllib` takes no text of TOML 1.1, and none that begins with a mark of its order
    of bytes, as cases may.
    """

def write_plan(path: _Path, text: str) -> None:
    """Writes a plan of `ballast sweep`. Of what lies there only another one is replaced. Raises FileError."""

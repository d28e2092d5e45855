"""Coupling schemes between a simulation and a partner, such as a model of a machine or a track.

    from ballast import couple

    coupling = couple.Coupling(sim, machine, "implicit", window_steps=4, tolerance=1e-6)
    while sim.now_ns < end_ns:
        window = coupling.advance()
        print(window.iterations, window.residual, window.energy_residual)

The partner moves bodies and feels the forces of the ballast on them. Its state of motion is one row for each body:
position of the reference point (m), rotation vector (rad), velocity (m/s) and angular velocity (rad/s), world axes.
Within a window the motion is cubic through the rows at both ends.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

import ballast

Floats = NDArray[np.float64]
#: Rows of a motion (12,) or forces and torques of each step (n, 6), by body.
Rows = Mapping[str, Floats]

SCHEMES = ("parallel", "staggered", "implicit")
ACCELERATIONS = ("fixed", "aitken", "iqn-ils")
#: Windows whose differences IQN-ILS uses besides those of the current one.
REUSED_WINDOWS = 3
#: Fraction of a column of differences that must be independent of the newer columns.
MIN_INDEPENDENT = 0.01
#: Differences of a window after which IQN-ILS starts again from a relaxed guess: contact forces jump, and older ones mislead it.
MAX_DIFFERENCES = 15


class Partner(Protocol):
    """Model that moves bodies of a simulation."""

    def advance(self, t0: float, t1: float, forces: Rows) -> Rows:
        """Advances the model from `t0` to `t1` (s since the start of the run) and returns the motion at `t1`.

        Args:
            t0: start of the window, where the model is.
            t1: end of the window.
            forces: force (N) and torque (N m) by the ballast on every driven body about its reference point, in each of the
                n steps of the window (n, 6).

        Returns:
            Rows (12,) of the bodies that the partner moves, the same bodies in every window.
        """

    def save(self) -> Any:
        """Returns the state of the model, which later windows must not change. Pickled, it continues in another process."""

    def restore(self, state: Any) -> None:
        """Restores a state of `save`."""


class CouplingError(RuntimeError):
    """A window of the simulation failed; simulation and partner are at its start. `result` is the failed result."""

    def __init__(self, result: ballast.WindowResult) -> None:
        super().__init__(f"{result.t1_ns * 1e-9:.6g} s: {result.status}, {result.code}: {result.error_message}")
        self.result = result


@dataclass(frozen=True)
class Window:
    """Result of a coupled window.

    Attributes:
        iterations: number of times the simulation computed the window.
        residual: largest difference between the motion of the partner and that of the simulation at the end, m. Rotations
            count with the coupling's lever, velocities with the length of the window.
        is_converged: true if the residual is within the tolerance; explicit schemes always converge.
        work_given: work of the partner on the ballast, by the forces and the motion that the partner computed with, J.
        work_received: work of the moved bodies on the ballast, by the simulation, J.
        motion: motion of the simulation at the end, by body (12,).
        result: result of the simulation, with its steps.
    """

    iterations: int
    residual: float
    is_converged: bool
    work_given: float
    work_received: float
    motion: Rows
    result: ballast.WindowResult

    @property
    def energy_residual(self) -> float:
        """Energy that the interface loses, J: work given by the partner minus work received by the ballast."""
        return self.work_given - self.work_received


@dataclass(frozen=True)
class Checkpoint:
    """State of a coupling: simulation, partner and memory of the scheme. It can be pickled."""

    simulation: ballast.State
    partner: Any
    memory: dict[str, Any]


class Coupling:
    """Coupling of a simulation and a partner, advanced in windows.

    Schemes:

    * "parallel": both sides compute the window at once. The partner feels the mean forces of the last window; the ballast
      follows the velocity with which the partner ended the last window.
    * "staggered": the partner computes first, with the mean forces of the last window; the ballast follows its motion.
    * "implicit": the window is repeated until the motion that the partner computes with the forces of the ballast is the one
      that the ballast followed.

    Args:
        sim: the simulation. Bodies that the partner moves must be rigid on their holder (`rigid = true` in `[tines.mount]`);
            mass and flexibility belong to the partner.
        partner: the model at the time of the simulation.
        scheme: "parallel", "staggered" or "implicit".
        window_steps: number of time steps of a window.
        acceleration: next guess of the implicit scheme: "fixed" relaxation, "aitken" (a factor for each iteration) or
            "iqn-ils" (quasi-Newton, from the differences of iterations).
        relaxation: factor of fixed relaxation, and of the first iteration of the others.
        tolerance: residual at which a window has converged, m.
        max_iterations: largest number of iterations of a window.
        lever: length by which rotations count in the residual, m.

    Raises:
        ValueError: an argument is out of range.
    """

    def __init__(
        self,
        sim: ballast.Simulation,
        partner: Partner,
        scheme: str = "implicit",
        *,
        window_steps: int = 4,
        acceleration: str = "iqn-ils",
        relaxation: float = 0.5,
        tolerance: float = 1e-6,
        max_iterations: int = 20,
        lever: float = 0.1,
    ) -> None:
        if scheme not in SCHEMES:
            raise ValueError(f"scheme: expected one of {', '.join(SCHEMES)}, found {scheme!r}")
        if acceleration not in ACCELERATIONS:
            raise ValueError(f"acceleration: expected one of {', '.join(ACCELERATIONS)}, found {acceleration!r}")
        if not 0.0 < relaxation <= 1.0:
            raise ValueError(f"relaxation: expected a number above 0 and up to 1, found {relaxation}")
        for name, value in {"window_steps": window_steps, "max_iterations": max_iterations}.items():
            if value < 1:
                raise ValueError(f"{name}: expected at least 1, found {value}")
        for name, length in {"tolerance": tolerance, "lever": lever}.items():
            if not 0.0 < length < math.inf:
                raise ValueError(f"{name}: expected a length above 0, m, found {length}")
        self.sim, self.partner, self.scheme = sim, partner, scheme
        self.window_steps, self.tolerance, self.max_iterations, self.lever = window_steps, tolerance, max_iterations, lever
        self._guess = _Guess(acceleration, relaxation)
        self._mean_forces = {name: np.zeros(6) for name in sim.bodies}
        # Motion at the end of the last window, by the partner and by the simulation.
        self._given: dict[str, Floats] = {}
        self._followed: dict[str, Floats] = {}
        self._t0_ns = self._t1_ns = sim.now_ns

    def advance(self) -> Window:
        """Computes the next window on both sides.

        Raises:
            CouplingError: the simulation cannot compute the window.
            ValueError: the partner moves a body that the simulation does not have, or one on a spring.
        """
        self._t0_ns = self.sim.now_ns
        self._t1_ns = self._t0_ns + self.window_steps * self.sim.step_ns
        start, before = self.sim.save(), self.partner.save()
        forces = {name: np.tile(mean, (self.window_steps, 1)) for name, mean in self._mean_forces.items()}
        try:
            if self.scheme == "parallel":
                return self._advance_parallel(forces)
            given = self._advance_partner(forces)
            if self.scheme == "staggered":
                return self._end(1, 0.0, True, given, given, forces, self._advance_simulation(given, again=False))
            return self._iterate(before, given)
        except CouplingError:
            if self.sim.now_ns != self._t0_ns:
                self.sim.restore(start)
            self.partner.restore(before)
            raise

    def save(self) -> Checkpoint:
        """Returns the state of both sides and of the scheme."""
        memory: dict[str, Any] = {"forces": dict(self._mean_forces), "given": dict(self._given), "followed": dict(self._followed)}
        memory |= {"guess": self._guess.save(), "window_steps": self.window_steps}
        return Checkpoint(self.sim.save(), self.partner.save(), memory)

    def restore(self, checkpoint: Checkpoint) -> None:
        """Restores a state of `save`, also of another process.

        With the same settings the coupling continues with the same bytes.
        """
        self.sim.restore(checkpoint.simulation)
        self.partner.restore(checkpoint.partner)
        memory = checkpoint.memory
        self._mean_forces, self._given, self._followed = (dict(memory[key]) for key in ("forces", "given", "followed"))
        if memory["window_steps"] == self.window_steps:
            # Differences of windows of another length say nothing.
            self._guess.restore(memory["guess"])

    def _advance_parallel(self, forces: Rows) -> Window:
        if not self._given:
            # Only the partner knows which bodies it moves, so the first window is staggered.
            given = self._advance_partner(forces)
            return self._end(1, 0.0, True, given, given, forces, self._advance_simulation(given, again=False))
        dt = self._length()
        predicted = {name: np.concatenate([row[:6] + dt * row[6:], row[6:]]) for name, row in self._given.items()}
        with ThreadPoolExecutor(1) as pool:
            computing = pool.submit(self._advance_partner, forces)
            result = self._advance_simulation(predicted, again=False)
            given = computing.result()
        residual = float(np.abs(self._scaled(given) - self._scaled(predicted)).max())
        return self._end(1, residual, True, given, predicted, forces, result)

    def _iterate(self, before: Any, guess: Rows) -> Window:
        names, scale = list(guess), self._scale(len(guess))
        self._guess.begin_window()
        last: Rows = {}
        for iteration in range(1, self.max_iterations + 1):
            try:
                result = self._advance_simulation(guess, again=self.sim.now_ns != self._t0_ns)
            except (CouplingError, ballast.RequestError) as error:
                concerns_motion = isinstance(error, CouplingError) or error.code == "input_invalid"
                if not (concerns_motion and last) or iteration == self.max_iterations:
                    raise
                # The guess was too far for the ballast.
                guess = {name: 0.5 * (last[name] + row) for name, row in guess.items()}
                self._guess.forget()
                continue
            last = guess
            forces = self._forces(result)
            self.partner.restore(before)
            given = self._advance_partner(forces)
            followed, answer = self._scaled(guess), self._scaled(given)
            residual = float(np.abs(answer - followed).max())
            if residual <= self.tolerance or iteration == self.max_iterations:
                break
            rows = self._guess.next(followed, answer) / scale
            guess = dict(zip(names, rows.reshape(-1, 12), strict=True))
        return self._end(iteration, residual, residual <= self.tolerance, given, guess, forces, result)

    def _advance_partner(self, forces: Rows) -> dict[str, Floats]:
        given = self.partner.advance(self._t0_ns * 1e-9, self._t1_ns * 1e-9, forces)
        if not self._followed:
            self._followed = {name: self._commanded(name) for name in given}
            self._given = dict(self._followed)
        return {name: np.asarray(given[name], dtype=float) for name in self._followed}

    def _commanded(self, name: str) -> Floats:
        """Returns the motion with which the next one of a body must start."""
        if name in self.sim.mounts:
            raise ValueError(f"{name}: expected a body without a mount, found one on springs; set `rigid = true`")
        state = self.sim.save()
        position, orientation = state.commanded_pose(name)
        velocity, angular_velocity = state.commanded_twist(name) or (np.zeros(3), np.zeros(3))
        return np.concatenate([position, _rotation_vector(orientation), velocity, angular_velocity])

    def _advance_simulation(self, end: Rows, *, again: bool) -> ballast.WindowResult:
        motions = {}
        for name, row in end.items():
            rows = np.stack([self._followed[name], row])
            motions[name] = ballast.Motion(
                [self._t0_ns, self._t1_ns],
                rows[:, :3],
                np.stack([_quaternion(r[3:6]) for r in rows]),
                velocities=rows[:, 6:9],
                angular_velocities=rows[:, 9:],
            )
        if again:
            result = self.sim.redo(motions, record_steps=True)
        else:
            result = self.sim.advance_to(self._t1_ns, motions, record_steps=True)
        if result.status not in ("ok", "warn"):
            raise CouplingError(result)
        return result

    def _forces(self, result: ballast.WindowResult) -> dict[str, Floats]:
        assert result.step_series is not None
        return {name: rows / (self.sim.step_ns * 1e-9) for name, rows in result.step_series.impulses.items()}

    def _end(
        self,
        iterations: int,
        residual: float,
        is_converged: bool,
        given: Rows,
        followed: Rows,
        used: Rows,
        result: ballast.WindowResult,
    ) -> Window:
        """Ends a window in which the partner moved to `given` under the forces `used`, the simulation to `followed`."""
        work_given = sum(
            -float((used[name] * _displacements(self._given[name], row, self._length(), self.window_steps)).sum())
            for name, row in given.items()
        )
        work_received = sum(result[name].work for name in given)
        self._mean_forces = {name: rows.mean(axis=0) for name, rows in self._forces(result).items()}
        self._given, self._followed = dict(given), dict(followed)
        return Window(iterations, residual, is_converged, work_given, work_received, dict(followed), result)

    def _length(self) -> float:
        """Returns the length of the window, s."""
        return (self._t1_ns - self._t0_ns) * 1e-9

    def _scale(self, bodies: int) -> Floats:
        dt, lever = self._length(), self.lever
        return np.tile(np.repeat([1.0, lever, dt, lever * dt], 3), bodies)

    def _scaled(self, rows: Rows) -> Floats:
        return np.concatenate(list(rows.values())) * self._scale(len(rows))


class _Guess:
    """Guesses of the motion from the iterations of a window, as vectors in m."""

    def __init__(self, acceleration: str, relaxation: float) -> None:
        self.acceleration, self.relaxation = acceleration, relaxation
        self.factor = relaxation
        # Differences of residuals and of answers between iterations, newest first, for each window.
        self.reused: list[list[tuple[Floats, Floats]]] = []
        self.differences: list[tuple[Floats, Floats]] = []
        self.last: tuple[Floats, Floats] | None = None

    def save(self) -> Any:
        return self.factor, list(self.reused), list(self.differences)

    def restore(self, state: Any) -> None:
        factor, reused, differences = state
        self.factor, self.reused, self.differences, self.last = factor, list(reused), list(differences), None

    def begin_window(self) -> None:
        if self.differences:
            self.reused = [self.differences, *self.reused][:REUSED_WINDOWS]
        self.differences, self.last = [], None

    def forget(self) -> None:
        """Forgets the differences, which have led too far."""
        self.reused, self.differences = [], []

    def next(self, followed: Floats, answer: Floats) -> Floats:
        residual = answer - followed
        if self.last is not None:
            self.differences.insert(0, (residual - self.last[0], answer - self.last[1]))
        before, self.last = self.last, (residual, answer)
        if self.acceleration == "iqn-ils" and len(self.differences) > MAX_DIFFERENCES:
            self.forget()
        elif self.acceleration == "iqn-ils":
            columns = _independent(self.differences + [pair for window in self.reused for pair in window])
            if columns:
                v, w = (np.stack(part, axis=1) for part in zip(*columns, strict=True))
                weights: Floats = np.linalg.lstsq(v, -residual, rcond=None)[0]
                return np.asarray(answer + w @ weights)
        if self.acceleration == "aitken" and before is not None:
            change = residual - before[0]
            self.factor *= -float(before[0] @ change) / max(float(change @ change), 1e-300)
            self.factor = math.copysign(min(abs(self.factor), 1.0), self.factor)
            return followed + self.factor * residual
        self.factor = self.relaxation
        return followed + self.relaxation * residual


def _independent(columns: list[tuple[Floats, Floats]]) -> list[tuple[Floats, Floats]]:
    """Returns the columns whose residuals are independent of those of the newer columns."""
    kept: list[tuple[Floats, Floats]] = []
    basis: list[Floats] = []
    for column in columns:
        rest = column[0].copy()
        for direction in basis:
            rest -= (direction @ rest) * direction
        size = float(np.linalg.norm(rest))
        if size > MIN_INDEPENDENT * float(np.linalg.norm(column[0])):
            basis.append(rest / size)
            kept.append(column)
    return kept


def _displacements(start: Floats, end: Floats, length: float, steps: int) -> Floats:
    """Returns displacement and rotation (n, 6) in each step of a cubic motion."""
    s = np.linspace(0.0, 1.0, steps + 1)[:, None]
    change = end[:6] - start[:6]
    way = s**2 * (3 - 2 * s) * change + length * (s * (1 - s) ** 2 * start[6:] - s**2 * (1 - s) * end[6:])
    return np.diff(way, axis=0)


def _quaternion(rotation: Floats) -> Floats:
    """Returns the quaternion x, y, z, w of a rotation vector."""
    angle = float(np.linalg.norm(rotation))
    # np.sinc(a) is sin(pi a)/(pi a), finite at zero.
    return np.append(0.5 * np.sinc(angle / (2 * math.pi)) * rotation, math.cos(0.5 * angle))


def _rotation_vector(quaternion: Floats) -> Floats:
    """Returns the rotation vector of a quaternion x, y, z, w, at most half a turn."""
    q = quaternion if quaternion[3] >= 0.0 else -quaternion
    sine = float(np.linalg.norm(q[:3]))
    half = math.atan2(sine, float(q[3]))
    return np.asarray(q[:3] * (2.0 if sine == 0.0 else 2.0 * half / sine))

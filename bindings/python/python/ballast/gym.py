"""Tamping as a Gymnasium environment: choose squeeze speed, vibration frequency and depth.

    import ballast.gym

    env = ballast.gym.TampingEnv("examples/first.toml")
    observation, info = env.reset(seed=1)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
"""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

import ballast
from ballast._zones import is_under, tamped_sleepers

Array = NDArray[np.float64]

#: Unit of observed forces, N.
FORCE_SCALE_N = 1e4
#: Range of the vibration frequency, Hz.
FREQUENCY_RANGE_HZ = (20.0, 50.0)
#: Maximum number of cached states after the lift; the beds used last are kept.
MAX_CACHED_STATES = 8


# Compared by identity: comparing arrays yields arrays, which have no hash.
@dataclass(frozen=True, eq=False)
class Episode:
    """A saved episode of `TampingEnv.save`. It can be pickled; equality is identity.

    Attributes:
        state: state of the simulation.
        home_positions: position of each tine's reference point at the start of the episode (3,), m.
        depth: fraction of the full depth, 0 to 1.
        closing: fraction of the stroke, 0 to 1.
        vibration_angle: phase angle of the vibration, rad.
        vibration_omega: angular frequency of the vibration, rad/s; 0 before it starts.
        work: work of the tines so far, J.
        initial_compactness: mean compactness under the tamped sleepers at the start of the episode.
        compactness: current mean compactness under the tamped sleepers.
        zones: last measured compactness of each zone under a tamped sleeper.
        forces: moving-average force on each tine (nt, 3), N.
        is_over: true after the episode has terminated or was truncated.
    """

    state: ballast.State
    home_positions: dict[str, Array]
    depth: float
    closing: float
    vibration_angle: float
    vibration_omega: float
    work: float
    initial_compactness: float
    compactness: float
    zones: dict[str, float]
    forces: Array
    is_over: bool


#: Fields of an episode besides the state; the environment has each as an attribute with a leading underscore.
_EPISODE_FIELDS = [field.name for field in fields(Episode) if field.name != "state"]


class TampingEnv(gymnasium.Env[Array, Array]):
    """Environment of one tamping cycle of a case.

    An episode starts after the lift of the sleeper, with the tines above the bed. Each step of the environment simulates
    `interval_s`; the last one ends with the run of the case.

    **Action** (3,), each from -1 to 1: mean squeeze speed (0 to `squeeze_speed`), vibration frequency (20 to 50 Hz), and depth
    (0 to 1 of the case's full depth), reached at a mean speed of at most `insertion_speed`. Each step starts and ends at
    rest, so peak speeds are 1.5 times the mean. The vibration amplitude is that of the case.

    **Observation** (7 + 3 nt,): depth and closing (0 to 1), compactness under the tamped sleepers, elapsed fraction of the
    run, moving-average force on each tine (4 ms, in 10 kN), and the vibration: sine and cosine of its phase angle, and its
    frequency divided by 50 Hz (0 before it starts).

    **Reward**: gain of compactness under the sleepers in per cent, minus `energy_price` times the work of the tines in J.
    `info` has "gain_percent", "work_J" and, from the start of the episode, "compaction_per_kJ".

    An episode terminates when the tines are fully closed, and is truncated at the end of the run. It is also truncated if the
    commanded motion cannot be computed; `info` then has "error_message" and "code", nothing has moved, and gain and work are 0.
    Values of an action outside -1 to 1 are clipped. After an exception such as KeyboardInterrupt a step can be repeated.

    Args:
        case: a `Case` or the path of a case file, with tines and with ballast under a tamped sleeper.
        interval_s: duration of a step of the environment, s; a whole number of time steps of the case.
        squeeze_speed: largest mean closing speed of a tine, m/s.
        insertion_speed: largest mean vertical speed of a tine, m/s.
        energy_price: reward per J of work.
        seeds: seeds of the beds that `reset` chooses from; default: the case's. A new bed takes a while to prepare.
        threads: number of computing threads; results do not depend on it.
        bed_cache: folder of prepared beds.
        render_mode: None; the environment draws nothing.

    Raises:
        Error: the case has no tines, or no ballast under a tamped sleeper.
        TypeError: `seeds` is not a list of whole numbers.
        ValueError: a number is out of range.
    """

    metadata = {"render_modes": []}

    def __init__(
        self,
        case: ballast.Case | str | os.PathLike[str],
        *,
        interval_s: float = 0.02,
        squeeze_speed: float = 0.2,
        insertion_speed: float = 0.6,
        energy_price: float = 1e-3,
        seeds: Sequence[int] | None = None,
        threads: int | None = 1,
        bed_cache: str | os.PathLike[str] = ballast.DEFAULT_BED_CACHE,
        render_mode: None = None,
    ) -> None:
        self.render_mode = render_mode
        self._case = case if isinstance(case, ballast.Case) else ballast.Case.load(case)
        self._tamped = tamped_sleepers(self._case)
        lengths = {"interval_s": interval_s, "squeeze_speed": squeeze_speed, "insertion_speed": insertion_speed}
        for name, value in lengths.items():
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name}: expected a number above 0, found {value}")
        if not math.isfinite(energy_price):
            raise ValueError(f"energy_price: expected a finite number, found {energy_price}")
        if render_mode is not None:
            raise ValueError(f"render_mode: expected None, as nothing is drawn, found {render_mode!r}")
        try:
            self._seeds = [operator.index(seed) for seed in (() if seeds is None else seeds)] or [self._case.seed]
        except TypeError:
            raise TypeError(f"seeds: expected a list of whole numbers, found {seeds!r}") from None
        self._steps = _step_count(interval_s, self._case.step_ns)
        self._squeeze_speed = squeeze_speed
        self._insertion_speed = insertion_speed
        self._energy_price = energy_price
        self._threads = threads
        self._bed_cache = bed_cache
        self._amplitude = float(
            self._case.to_dict().get("tamping", {}).get("vibration", {}).get("amplitude_m", 0.005)
        )
        self._cached_states: dict[int, ballast.State] = {}
        self._sim: ballast.Simulation | None = None
        self._is_over = False
        with self._simulation_after_lift(self._seeds[0]) as sim:
            tines = len(sim.tines)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (7 + 3 * tines,), np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Starts an episode on a bed chosen from `seeds`; returns the observation, and `info` with "bed_seed"."""
        super().reset(seed=seed)
        bed_seed = self._seeds[int(self.np_random.integers(len(self._seeds)))]
        self.close()
        self._sim = self._simulation_after_lift(bed_seed)
        self._is_over = False
        self._tines = self._sim.tines
        # Commanded, not actual: the step that ends the lift may already lower the tines.
        start = self._sim.save()
        self._home_positions = {tine.name: start.commanded_pose(tine.name)[0] for tine in self._tines}
        self._depth = self._closing = self._vibration_angle = self._vibration_omega = self._work = 0.0
        self._zones = self._compactness_under_tamped(self._sim.zones())
        self._compactness = self._initial_compactness = _mean(self._zones)
        self._forces = np.zeros((len(self._tines), 3))
        return self._observe(), {"bed_seed": bed_seed}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Simulates one interval; returns observation, reward, terminated, truncated and `info`.

        Raises:
            Error: there is no running episode, or the action is not three finite numbers.
        """
        if self._sim is None or self._is_over:
            found = "none" if self._sim is None else "one that has ended"
            raise ballast.Error(f"step: expected an episode, found {found}; reset first")
        try:
            values = np.asarray(action, np.float64)
            is_valid = values.shape == self.action_space.shape and bool(np.isfinite(values).all())
        except (TypeError, ValueError):
            is_valid = False
        if not is_valid:
            raise ballast.Error(f"action: expected 3 numbers from -1 to 1, found {action!r}")
        sim = self._sim
        n = min(self._steps, self._remaining_steps(sim.now_ns))
        motions, end = self._motions(np.clip(values, -1.0, 1.0), n)
        start = sim.save()
        try:
            result = sim.advance_to(sim.now_ns + n * sim.step_ns, motions, zones=True)
        except BaseException:
            # Ctrl-C ends the window at any of its steps; a repeated step starts where this one did.
            sim.restore(start)
            raise
        if result.status not in ("ok", "warn"):
            # A partial window would leave the tines between two poses of the environment.
            sim.restore(start)
            self._is_over = True
            info = self._info(0.0, 0.0) | {"error_message": result.error_message, "code": result.code}
            return self._observe(), 0.0, False, True, info
        self._depth, self._closing, self._vibration_angle, self._vibration_omega = end
        # A zone that cannot be measured keeps its value: the mean must not jump without any motion.
        measured = self._compactness_under_tamped(result.zones)
        self._zones = {name: measured.get(name, last) for name, last in self._zones.items()}
        compactness_before = self._compactness
        self._compactness = _mean(self._zones)
        self._forces = np.array([result[tine.name].moving_average_force for tine in self._tines])
        work = sum(result[tine.name].work for tine in self._tines)
        self._work += work
        gain = 100.0 * (self._compactness - compactness_before)
        reward = gain - self._energy_price * work
        is_closed = self._closing >= 1.0
        is_at_end = self._remaining_steps(sim.now_ns) == 0
        self._is_over = is_closed or is_at_end
        return self._observe(), float(reward), is_closed, is_at_end and not is_closed, self._info(gain, work)

    def save(self) -> Episode:
        """Returns the current episode, for `restore`.

        Raises:
            Error: there is no episode.
        """
        if self._sim is None:
            raise ballast.Error("save: expected an episode, found none; reset first")
        return Episode(self._sim.save(), **{name: getattr(self, f"_{name}") for name in _EPISODE_FIELDS})

    def restore(self, episode: Episode) -> Array:
        """Continues from a saved episode of this case, also of another environment; returns the observation.

        Raises:
            Error: the episode belongs to another case.
        """
        sim = ballast.resume(episode.state, threads=self._threads)
        if sim.case.choose(seed=self._case.seed) != self._case:
            raise ballast.Error(f"restore: expected an episode of {self._case!r}, found one of {sim.case!r}")
        self.close()
        self._sim = sim
        self._tines = sim.tines
        for name in _EPISODE_FIELDS:
            setattr(self, f"_{name}", getattr(episode, name))
        return self._observe()

    def close(self) -> None:
        """Ends the simulation of the episode."""
        if self._sim is not None:
            self._sim.close()
            self._sim = None

    def _simulation_after_lift(self, bed_seed: int) -> ballast.Simulation:
        """Returns a simulation after the lift; the states of the last beds are cached."""
        state = self._cached_states.pop(bed_seed, None)
        if state is None:
            with ballast.open(
                self._case, seed=bed_seed, threads=self._threads, bed_cache=self._bed_cache, progress=False
            ) as sim:
                if not sim.tines:
                    raise ballast.Error(f"{self._case!r}: expected a case with tines, found none")
                while sim.phase in ("waiting", "lift"):
                    result = sim.step_tamping_cycle()
                    if result.status not in ("ok", "warn"):
                        # Repeating the step would fail again.
                        raise ballast.Error(f"{result!r}: {result.error_message}")
                if not self._compactness_under_tamped(sim.zones()):
                    found = "expected a case with ballast under a tamped sleeper, found none"
                    raise ballast.Error(f"{self._case!r}: {found}")
                state = sim.save()
        # Dictionaries keep insertion order: the first state is the least recently used.
        self._cached_states[bed_seed] = state
        if len(self._cached_states) > MAX_CACHED_STATES:
            del self._cached_states[next(iter(self._cached_states))]
        return ballast.resume(state, threads=self._threads)

    def _compactness_under_tamped(self, zones: dict[str, ballast.ZoneResult]) -> dict[str, float]:
        """Returns the compactness of all zones under tamped sleepers that can be measured."""
        under = {name: zone.compactness for name, zone in zones.items() if is_under(name, self._tamped)}
        return {name: value for name, value in under.items() if value is not None}

    def _remaining_steps(self, now_ns: int) -> int:
        """Returns the number of complete time steps until the end of the case's run."""
        return (self._case.duration_ns - now_ns) // self._case.step_ns

    def _motions(
        self, action: Array, n: int
    ) -> tuple[dict[str, ballast.Motion], tuple[float, float, float, float]]:
        """Returns the motions of the tines for `n` time steps, and depth, closing, angle and omega at their end."""
        assert self._sim is not None
        squeeze, frequency_fraction, target_depth = (float(value) for value in 0.5 * (action + 1.0))
        low, high = FREQUENCY_RANGE_HZ
        end_omega = math.tau * (low + frequency_fraction * (high - low))
        duration = n * self._sim.step_ns * 1e-9
        # The longest way limits the common depth, so that no tine exceeds the insertion speed.
        way = max(float(self._home_positions[tine.name][2] - tine.full_depth_z) for tine in self._tines)
        max_change = self._insertion_speed * duration / way if way > 0.0 else 1.0
        end_depth = self._depth + float(np.clip(target_depth - self._depth, -max_change, max_change))
        stroke = max(self._tines[0].stroke, 1e-9)
        end_closing = min(1.0, self._closing + squeeze * self._squeeze_speed * duration / stroke)
        # Depth and closing follow a cubic from rest to rest. The frequency changes linearly, so that the velocity is
        # continuous between intervals; in the first interval the amplitude grows along the cubic.
        s = np.linspace(0.0, 1.0, n + 1)
        ease = s * s * (3.0 - 2.0 * s)
        ease_rate = 6.0 * s * (1.0 - s) / duration
        start_omega = self._vibration_omega or end_omega
        omega = start_omega + (end_omega - start_omega) * s
        angle = self._vibration_angle + (start_omega * s + 0.5 * (end_omega - start_omega) * s * s) * duration
        starts = self._vibration_omega == 0.0
        growth = ease if starts else np.ones(n + 1)
        growth_rate = ease_rate if starts else np.zeros(n + 1)
        vibration = self._amplitude * growth * np.sin(angle)
        vibration_rate = self._amplitude * (growth_rate * np.sin(angle) + growth * omega * np.cos(angle))
        times = [self._sim.now_ns + i * self._sim.step_ns for i in range(n + 1)]
        depth = self._depth + (end_depth - self._depth) * ease
        closing = self._closing + (end_closing - self._closing) * ease
        motions = {}
        for tine in self._tines:
            home = self._home_positions[tine.name]
            full_depth = tine.full_depth_z - home[2]
            x = np.empty((n + 1, 3))
            x[:, 0] = home[0] + tine.direction * (tine.stroke * closing + vibration)
            x[:, 1] = home[1]
            x[:, 2] = home[2] + full_depth * depth
            v = np.zeros((n + 1, 3))
            v[:, 0] = tine.direction * (tine.stroke * (end_closing - self._closing) * ease_rate + vibration_rate)
            v[:, 2] = full_depth * (end_depth - self._depth) * ease_rate
            motions[tine.name] = ballast.Motion(times, x, velocities=v)
        return motions, (end_depth, end_closing, float(angle[-1]) % math.tau, end_omega)

    def _info(self, gain: float, work: float) -> dict[str, Any]:
        info: dict[str, Any] = {"gain_percent": gain, "work_J": work}
        if self._work > 0.0:
            gain_since_start = self._compactness - self._initial_compactness
            info["compaction_per_kJ"] = gain_since_start / (self._work * 1e-3)
        return info

    def _observe(self) -> Array:
        assert self._sim is not None
        elapsed = self._sim.now_ns / self._case.duration_ns
        progress = [self._depth, self._closing, self._compactness, elapsed]
        frequency = self._vibration_omega / (math.tau * FREQUENCY_RANGE_HZ[1])
        vibration = [math.sin(self._vibration_angle), math.cos(self._vibration_angle), frequency]
        return np.concatenate([progress, (self._forces / FORCE_SCALE_N).ravel(), vibration])


def _mean(values: dict[str, float]) -> float:
    return sum(values.values()) / len(values)


def _step_count(interval_s: float, step_ns: int) -> int:
    """Returns the number of time steps in an interval."""
    interval_ns = round(interval_s * 1e9)
    n, rest = divmod(interval_ns, step_ns)
    if rest or n == 0:
        nearest = " or ".join(f"{k * step_ns * 1e-9:.9g}" for k in (n, n + 1) if k > 0)
        step = f"{step_ns * 1e-9:.9g} s"
        raise ValueError(f"interval_s: expected a whole number of steps of {step}, such as {nearest}, found {interval_s}")
    return n

"""Tamping as an environment of Gymnasium: how fast to squeeze, at which frequency, how deep.

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

Array = NDArray[np.float64]

#: Forces are observed in units of this, N.
FORCE = 1e4
#: Range of the frequency, Hz.
FREQUENCIES = (20.0, 50.0)
#: States after the lift that are kept: those of the beds that were asked for last.
MAX_CACHED_STATES = 8


# As of themselves: arrays are compared number by number, and have no hash.
@dataclass(frozen=True, eq=False)
class Episode:
    """An episode as it stands: of `TampingEnv.save`. It can be pickled. Only itself is equal to it."""

    state: ballast.State
    homes: dict[str, Array]
    depth: float
    closing: float
    angle: float
    omega: float
    work: float
    first: float
    compactness: float
    zones: dict[str, float]
    forces: Array
    is_over: bool


#: What an environment keeps of its episode beside the state, each under its name after an underscore.
_KEPT = [field.name for field in fields(Episode) if field.name != "state"]


class TampingEnv(gymnasium.Env[Array, Array]):
    """One cycle of squeezing with the tines of a case.

    An episode begins after the lift of the sleeper, with the tines above the bed. Each step of the
    environment is `interval_s` of simulated time, a whole number of the case's steps; the last one is as long as what is
    left of the case's.

    **Action** (3,), each from -1 to 1: squeeze speed (0 to `squeeze_speed`, m/s), frequency of the vibration
    (20 to 50 Hz), depth that the tines are lowered or raised to (0 to 1 of the case's), at
    `insertion_speed` at most. Speeds are means over a step of the environment, which begins and ends at rest: the greatest is
    half as much again. The amplitude is the case's.

    **Observation** (7 + 3 nt,): depth (0 to 1), closing (0 to 1 of the stroke), compactness under the tamped
    sleepers, share of the time that is over, the mean force of the last 4 ms on each tine, in 10 kN, and of the
    vibration, which the next step takes over: sine and cosine of its angle, and its frequency in 50 Hz, 0 before it begins.

    **Reward**: gain of compactness under the sleepers in per cent, less `energy_price` times the work of the
    tines in J. `info` has both, and `compaction_per_kJ` since the start of the episode.

    An episode ends when the tines are closed for good, is truncated when the time of the case is over, and is
    truncated with `info["error_message"]` and its `info["code"]` where the motion that was asked for cannot be computed:
    nothing has moved then, and gain and work are 0. A step after its end is refused until `reset`, and so is an action
    that is no three numbers; numbers beyond -1 and 1 count as these.
    A step that ends with an exception, such as that of Ctrl-C, has not been: it can be made again.
    `save` keeps an episode as it stands, and `restore` goes on from there, in another environment of the case too.
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
        """
        Args:
            case: a case with tines and with ballast under a tamped sleeper.
            interval_s: refused where it is no whole number of steps of the case.
            seeds: of the beds that `reset` chooses from; by default that of the case alone. Preparing a
                bed takes a while the first time.
            threads: workers of the simulation; the results do not depend on it.
        """
        self.render_mode = render_mode
        self._case = case if isinstance(case, ballast.Case) else ballast.Case.load(case)
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
        self._steps = _steps(interval_s, self._case.step_ns)
        self._limits = (squeeze_speed, insertion_speed, energy_price)
        self._threads, self._bed_cache = threads, bed_cache
        self._amplitude = float(
            self._case.to_dict().get("tamping", {}).get("vibration", {}).get("amplitude_m", 0.005)
        )
        self._begun: dict[int, ballast.State] = {}
        self._sim: ballast.Simulation | None = None
        self._is_over = False
        with self._start(self._seeds[0]) as sim:
            tines = len(sim.tines)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (3,), np.float64)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (7 + 3 * tines,), np.float64)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        super().reset(seed=seed)
        bed = self._seeds[int(self.np_random.integers(len(self._seeds)))]
        self.close()
        self._sim, self._is_over = self._start(bed), False
        self._tines = self._sim.tines
        # Where they hang; a step that ended the lift may have begun to lower them.
        begun = self._sim.save()
        self._homes = {tine.name: begun.commanded_pose(tine.name)[0] for tine in self._tines}
        self._depth = self._closing = self._angle = self._omega = self._work = 0.0
        self._zones = _under(self._sim.zones())
        self._compactness = self._first = _mean(self._zones)
        self._forces = np.zeros((len(self._tines), 3))
        return self._observe(), {"bed_seed": bed}

    def step(self, action: Array) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        if self._sim is None or self._is_over:
            found = "none" if self._sim is None else "one that has ended"
            raise ballast.Error(f"step: expected an episode, found {found}; reset first")
        try:
            asked = np.asarray(action, np.float64)
            is_one = asked.shape == self.action_space.shape and np.isfinite(asked).all()
        except (TypeError, ValueError):
            is_one = False
        if not is_one:
            raise ballast.Error(f"action: expected 3 numbers from -1 to 1, found {action!r}")
        sim, was = self._sim, self._compactness
        n = min(self._steps, self._left(sim.now_ns))
        tools, after = self._motions(np.clip(asked, -1.0, 1.0), n)
        begun = sim.save()
        try:
            out = sim.advance_to(sim.now_ns + n * sim.step_ns, tools, zones=True)
        except BaseException:
            # Ctrl-C ends the window within any of its steps; the next motions begin where this one did.
            sim.restore(begun)
            raise
        if out.status not in ("ok", "warn"):
            # What a window has come to before it was stopped is not kept: the tines would stand amid their ways.
            sim.restore(begun)
            self._is_over = True
            return self._observe(), 0.0, False, True, self._info(0.0, 0.0, error_message=out.error_message, code=out.code)
        self._depth, self._closing, self._angle, self._omega = after
        # A zone that cannot be measured now keeps its value, or the mean would jump without any stone's moving.
        now = _under(out.zones)
        self._zones = {name: now.get(name, last) for name, last in self._zones.items()}
        self._compactness = _mean(self._zones)
        self._forces = np.array([out[t.name].moving_average_force for t in self._tines])
        work = sum(out[t.name].work for t in self._tines)
        self._work += work
        gain = 100.0 * (self._compactness - was)
        reward = gain - self._limits[2] * work
        closed = self._closing >= 1.0
        late = self._left(sim.now_ns) == 0
        self._is_over = closed or late
        return self._observe(), float(reward), closed, late and not closed, self._info(gain, work)

    def save(self) -> Episode:
        """The episode as it stands, to be taken up again by `restore`."""
        if self._sim is None:
            raise ballast.Error("save: expected an episode, found none; reset first")
        return Episode(self._sim.save(), **{name: getattr(self, f"_{name}") for name in _KEPT})

    def restore(self, episode: Episode) -> Array:
        """Goes on from a saved episode of this case, and returns what is observed there."""
        sim = ballast.resume(episode.state, threads=self._threads)
        if sim.case.choose(seed=self._case.seed) != self._case:
            raise ballast.Error(f"restore: expected an episode of {self._case!r}, found one of {sim.case!r}")
        self.close()
        self._sim, self._tines = sim, sim.tines
        for name in _KEPT:
            setattr(self, f"_{name}", getattr(episode, name))
        return self._observe()

    def close(self) -> None:
        if self._sim is not None:
            self._sim.close()
            self._sim = None

    def _start(self, bed: int) -> ballast.Simulation:
        """The simulation after the lift, computed once per bed, unless many others came after it."""
        begun = self._begun.pop(bed, None)
        if begun is None:
            with ballast.open(
                self._case, seed=bed, threads=self._threads, bed_cache=self._bed_cache, progress=False
            ) as sim:
                if not sim.tines:
                    raise ballast.Error(f"{self._case!r}: expected a case with tines, found none")
                while sim.phase in ("waiting", "lift"):
                    out = sim.step_tamping_cycle()
                    if out.status not in ("ok", "warn"):
                        # The same step again would end in the same way.
                        raise ballast.Error(f"{out!r}: {out.error_message}")
                if not _under(sim.zones()):
                    found = "expected a case with ballast under a tamped sleeper, found none"
                    raise ballast.Error(f"{self._case!r}: {found}")
                # The tines hang still; the sleeper has come to rest at the top.
                begun = sim.save()
        # The last one that was asked for is the last one.
        self._begun[bed] = begun
        if len(self._begun) > MAX_CACHED_STATES:
            del self._begun[next(iter(self._begun))]
        return ballast.resume(begun, threads=self._threads)

    def _left(self, now_ns: int) -> int:
        """Whole steps to the end of the case's run."""
        return (self._case.duration_ns - now_ns) // self._case.step_ns

    def _motions(
        self, action: Array, n: int
    ) -> tuple[dict[str, ballast.Motion], tuple[float, float, float, float]]:
        """Motions of the tines through the next `n` steps, and where they leave them."""
        assert self._sim is not None
        speed, lowering, _ = self._limits
        share = 0.5 * (action + 1.0)
        frequency = FREQUENCIES[0] + float(share[1]) * (FREQUENCIES[1] - FREQUENCIES[0])
        seconds = n * self._sim.step_ns * 1e-9
        # Blades of other heights have other ways; none goes faster than it may.
        way = max(float(self._homes[tine.name][2] - tine.full_depth_z) for tine in self._tines)
        most = lowering * seconds / way if way > 0.0 else 1.0
        depth = self._depth + float(np.clip(share[2] - self._depth, -most, most))
        closing = min(1.0, self._closing + float(share[0]) * speed * seconds / max(self._tines[0].stroke, 1e-9))
        s = np.linspace(0.0, 1.0, n + 1)
        # From rest to rest, but for the vibration; its frequency glides, so that no speed jumps where two
        # intervals join, and its amplitude grows within the first one.
        ease, rate = s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s) / seconds
        to = math.tau * frequency
        start = self._omega or to
        omega = start + (to - start) * s
        angle = self._angle + (start * s + 0.5 * (to - start) * s * s) * seconds
        grown, growth = (ease, rate) if self._omega == 0.0 else (np.ones(n + 1), np.zeros(n + 1))
        shake = self._amplitude * grown * np.sin(angle)
        shaking = self._amplitude * (growth * np.sin(angle) + grown * omega * np.cos(angle))
        times = [self._sim.now_ns + i * self._sim.step_ns for i in range(n + 1)]
        down = self._depth + (depth - self._depth) * ease
        closed = self._closing + (closing - self._closing) * ease
        tools = {}
        for tine in self._tines:
            x, v = np.empty((n + 1, 3)), np.zeros((n + 1, 3))
            home = self._homes[tine.name]
            x[:, 0] = home[0] + tine.direction * (tine.stroke * closed + shake)
            x[:, 1] = home[1]
            x[:, 2] = home[2] + (tine.full_depth_z - home[2]) * down
            v[:, 0] = tine.direction * (tine.stroke * (closing - self._closing) * rate + shaking)
            v[:, 2] = (tine.full_depth_z - home[2]) * (depth - self._depth) * rate
            tools[tine.name] = ballast.Motion(times, x, velocities=v)
        return tools, (depth, closing, float(angle[-1]) % math.tau, to)

    def _info(self, gain: float, work: float, **failure: str | None) -> dict[str, Any]:
        info: dict[str, Any] = {"gain_percent": gain, "work_J": work}
        if self._work > 0.0:
            info["compaction_per_kJ"] = (self._compactness - self._first) / (self._work * 1e-3)
        return info | failure

    def _observe(self) -> Array:
        assert self._sim is not None
        time = self._sim.now_ns / self._case.duration_ns
        head = [self._depth, self._closing, self._compactness, time]
        shaking = [math.sin(self._angle), math.cos(self._angle), self._omega / (math.tau * FREQUENCIES[1])]
        return np.concatenate([head, (self._forces / FORCE).ravel(), shaking])


def _under(zones: dict[str, ballast.ZoneResult]) -> dict[str, float]:
    """Compactness of the zones under tamped sleepers, of those that can be measured."""
    under = {name: zone.compactness for name, zone in zones.items() if name.startswith("under/")}
    return {name: value for name, value in under.items() if value is not None}


def _mean(values: dict[str, float]) -> float:
    return sum(values.values()) / len(values)


def _steps(interval_s: float, step_ns: int) -> int:
    """How many steps an interval is."""
    interval_ns = round(interval_s * 1e9)
    n, rest = divmod(interval_ns, step_ns)
    if rest or n == 0:
        nearest = " or ".join(f"{k * step_ns * 1e-9:.9g}" for k in (n, n + 1) if k > 0)
        step = f"{step_ns * 1e-9:.9g} s"
        raise ValueError(f"interval_s: expected a whole number of steps of {step}, such as {nearest}, found {interval_s}")
    return n

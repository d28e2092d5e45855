"""Coupling schemes, with a mass on a spring as the partner."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import ballast
import numpy as np
import pytest
from ballast import couple


class Press:
    """A tine on a mass, which a spring presses into the bed."""

    stiffness, damping, speed = 5e4, 500.0, 0.3

    def __init__(self, sim: ballast.Simulation, mass: float = 20.0) -> None:
        self.name, self.start, self.mass = sim.tines[0].name, sim.tines[0].start, mass
        self.state = np.zeros(2)
        self.calls = 0

    def advance(self, t0: float, t1: float, forces: couple.Rows) -> couple.Rows:
        self.calls += 1
        z, v = self.state
        h = (t1 - t0) / len(forces[self.name])
        for k, force in enumerate(forces[self.name][:, 2]):
            end = -self.speed * (t0 + (k + 0.5) * h)
            # Implicit midpoint rule.
            a = self.mass / h + self.damping / 2 + self.stiffness * h / 4
            b = (self.mass / h - self.damping / 2 - self.stiffness * h / 4) * v + self.stiffness * (end - z) + force
            z, v = z + h * (v + b / a) / 2, b / a
        self.state = np.array([z, v])
        return {self.name: np.array([*(self.start + [0, 0, z]), 0, 0, 0, 0, 0, v, 0, 0, 0])}

    def save(self) -> Any:
        return self.state

    def restore(self, state: Any) -> None:
        self.state = state


@pytest.fixture(scope="module")
def pressed(case: ballast.Case) -> ballast.Case:
    """The small case with rigid tines and compliant contacts."""
    return case.with_values(
        {
            "tines.mount": {"rigid": True},
            "bed.stiffness": {"grain_N_per_m": 1e6},
            "run.step_s": 5e-4,
            "solver.max_iterations": 200,
            "solver.tolerance": 1e-4,
        }
    )


@pytest.fixture
def sim(pressed: ballast.Case, beds: Path) -> Iterator[ballast.Simulation]:
    with ballast.open(pressed, bed_cache=beds, threads=1, progress=False) as sim:
        yield sim


def run(coupling: couple.Coupling, steps: int) -> list[couple.Window]:
    windows = [coupling.advance() for _ in range(steps // coupling.window_steps)]
    assert max(abs(w.result[coupling.partner.name].mean_force[2]) for w in windows) > 50.0, "the tine touches no stone"
    return windows


@pytest.mark.parametrize("acceleration", couple.ACCELERATIONS)
def test_implicit_windows_converge(sim: ballast.Simulation, acceleration: str) -> None:
    coupling = couple.Coupling(sim, Press(sim), acceleration=acceleration, tolerance=1e-7)
    windows = run(coupling, 240)
    assert all(w.is_converged and w.residual <= 1e-7 for w in windows)
    assert coupling.partner.calls == sum(w.iterations + 1 for w in windows)
    given, lost = sum(w.work_given for w in windows), sum(abs(w.energy_residual) for w in windows)
    assert lost < 1e-3 * given


def test_the_motion_of_a_window_is_the_partners(sim: ballast.Simulation) -> None:
    press = Press(sim)
    window = couple.Coupling(sim, press, tolerance=1e-8).advance()
    row = window.motion[press.name]
    assert row[2] == pytest.approx(press.start[2] + press.state[0], abs=1e-8)
    assert np.array_equal(window.result[press.name].position, row[:3])


def test_explicit_schemes_lose_energy_and_improve_with_shorter_windows(sim: ballast.Simulation) -> None:
    lost = {}
    for scheme in ("parallel", "staggered"):
        for steps in (8, 2):
            with sim.fork() as copy:
                windows = run(couple.Coupling(copy, Press(copy), scheme, window_steps=steps), 240)
            assert all(w.iterations == 1 for w in windows)
            lost[scheme, steps] = sum(abs(w.energy_residual) for w in windows)
    with sim.fork() as copy:
        implicit = sum(abs(w.energy_residual) for w in run(couple.Coupling(copy, Press(copy)), 240))
    for scheme in ("parallel", "staggered"):
        assert 10 * implicit < lost[scheme, 2] < 0.3 * lost[scheme, 8]


class SprungSleeper(Press):
    """The sleeper as a mass on a spring, whose upper end moves down; the spring carries the weight from the start."""

    stiffness, damping, speed = 1e5, 2e3, 0.1

    def __init__(self, sim: ballast.Simulation, mass: float = 50.0) -> None:
        super().__init__(sim, mass)
        [self.name] = [name for name, role in sim.roles.items() if role == "sleeper"]
        self.start = np.array(sim.save().commanded_pose(self.name)[0])

    def advance(self, t0: float, t1: float, forces: couple.Rows) -> couple.Rows:
        # The damper, too, is between the body and the upper end.
        felt = forces[self.name] - [0, 0, self.damping * self.speed, 0, 0, 0]
        return super().advance(t0, t1, {self.name: felt})


@pytest.mark.parametrize("scheme", ["implicit", "staggered"])
def test_a_coupled_mass_on_a_spring_agrees_with_a_mount(pressed: ballast.Case, beds: Path, scheme: str) -> None:
    soft = pressed.with_values({"bed.stiffness.grain_N_per_m": 3e5, "solver.max_iterations": 2000, "solver.tolerance": 1e-5})
    with ballast.open(soft, bed_cache=beds, threads=1, progress=False) as sim:
        body = SprungSleeper(sim)
        coupling = couple.Coupling(sim, body, scheme, window_steps=2, tolerance=1e-8)
        windows = [coupling.advance().result for _ in range(120)]
    mount = {"z": "spring", "stiffness_N_per_m": body.stiffness, "damping_N_s_per_m": body.damping, "mass_kg": body.mass}
    with ballast.open(soft.with_values({"sleepers.mount": mount}), bed_cache=beds, threads=1, progress=False) as sim:
        mounted = []
        for _ in range(120):
            times = [sim.now_ns, sim.now_ns + 2 * sim.step_ns]
            path = [body.start - [0, 0, body.speed * t * 1e-9] for t in times]
            mounted.append(sim.advance_to(times[1], {body.name: ballast.Motion(times, path)}))
    peaks, works = zip(*((max(w[body.name].peak_force[2] for w in run), sum(w[body.name].work for w in run))
                         for run in (windows, mounted)), strict=True)  # fmt: skip
    assert peaks[0] > 400.0 and peaks[0] == pytest.approx(peaks[1], rel=0.05)
    assert works[0] == pytest.approx(works[1], rel=0.05)


@pytest.mark.parametrize("scheme", couple.SCHEMES)
def test_a_restored_coupling_continues_with_the_same_bytes(pressed: ballast.Case, beds: Path, scheme: str) -> None:
    def begin() -> couple.Coupling:
        sim = ballast.open(pressed, bed_cache=beds, threads=1, progress=False)
        return couple.Coupling(sim, Press(sim), scheme)

    undisturbed, killed = begin(), begin()
    run(undisturbed, 240)
    run(killed, 200)
    saved = pickle.dumps(killed.save())
    killed.sim.close()
    continued = begin()
    continued.restore(pickle.loads(saved))
    for _ in range(10):
        continued.advance()
    assert continued.sim.save().hash == undisturbed.sim.save().hash
    assert np.array_equal(continued.partner.state, undisturbed.partner.state)


def test_a_failed_window_changes_neither_side(sim: ballast.Simulation) -> None:
    press = Press(sim)
    press.speed = 4000.0
    coupling = couple.Coupling(sim, press)
    before = sim.save().hash
    with pytest.raises(couple.CouplingError, match="over_speed") as failed:
        for _ in range(20):
            before, state = sim.save().hash, press.state
            coupling.advance()
    assert failed.value.result.status == "discard"
    assert sim.save().hash == before and press.state is state


def test_a_guess_too_far_for_the_ballast_is_taken_back(sim: ballast.Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    guess, far = couple._Guess.next, []

    def first_too_far(self: couple._Guess, followed: couple.Floats, answer: couple.Floats) -> couple.Floats:
        if not far:
            far.append(followed + 0.5)
            return far[0]
        return guess(self, followed, answer)

    monkeypatch.setattr(couple._Guess, "next", first_too_far)
    windows = run(couple.Coupling(sim, Press(sim), tolerance=1e-7), 240)
    assert far and all(w.is_converged for w in windows)


def test_forces_that_jump_do_not_stall_the_iterations() -> None:
    """Each component jumps by 1.2 um at many places, as forces do where stones slip; the tolerance is 2 um."""
    for seed in range(10):
        rng, n = np.random.default_rng(seed), 24
        slope, offset, motion = rng.uniform(-0.6, -0.3, n), 3e-4 * rng.normal(size=n), np.zeros(n)
        guess = couple._Guess("iqn-ils", 0.5)
        guess.begin_window()
        for _ in range(60):
            jump = np.sin(1e6 * motion.sum() + np.arange(n)) + np.sign(np.sin(1e6 * motion + np.arange(n)))
            answer = slope * motion + offset + 1.2e-6 * jump
            residual = np.abs(answer - motion).max()
            if residual <= 2e-6:
                break
            motion = guess.next(motion, answer)
        assert residual <= 2e-6, seed


def test_bodies_on_springs_are_refused(case: ballast.Case, beds: Path) -> None:
    with ballast.open(case, bed_cache=beds, threads=1, progress=False) as sim:
        with pytest.raises(ValueError, match="rigid = true"):
            couple.Coupling(sim, Press(sim)).advance()


@pytest.mark.parametrize(
    "wrong",
    [{"scheme": "loose"}, {"acceleration": "none"}, {"relaxation": 0.0}, {"window_steps": 0}, {"max_iterations": 0},
     {"tolerance": 0.0}, {"lever": np.inf}],
)  # fmt: skip
def test_settings_out_of_range_are_refused(sim: ballast.Simulation, wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        couple.Coupling(sim, Press(sim), **wrong)


def test_rotations_are_vectors() -> None:
    for vector in ([0.0, 0.0, 0.0], [0.3, -0.2, 0.1], [0.0, 3.0, 0.0], [1e-9, 0.0, 0.0]):
        quaternion = couple._quaternion(np.array(vector))
        assert np.linalg.norm(quaternion) == pytest.approx(1.0)
        assert couple._rotation_vector(-quaternion) == pytest.approx(vector)

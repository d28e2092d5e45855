"""Model of a track: a rail on pads and sleepers, and a wheel that passes.

The rail is an Euler-Bernoulli beam of finite elements. Three sleepers stand on the simulated ballast and move in z and about
y. Beyond them sleepers of the model stand on springs that press but do not pull, so that a rail that is higher at one
sleeper lifts its neighbours. `Track` is a partner of `ballast.couple`: it integrates rail, sleepers and wheel by the implicit
midpoint rule, and its energies with them. The strip of ballast carries a share of one rail seat, by which all stiffnesses,
masses and loads are multiplied. SI units.
"""

import math
from dataclasses import dataclass

import numpy as np

GRAVITY = 9.81
ELEMENTS_PER_BAY = 2
MAX_SUPPORT_ITERATIONS = 20


@dataclass(frozen=True)
class Parameters:
    """Parameters of a track of one rail. Origins: [P] published, [S] standard, [G] geometry of the case, [E] estimate."""

    bending_stiffness: float = 6.4e6  # N m2; [S] UIC60
    rail_mass: float = 60.2  # kg/m; [S] UIC60
    pad_stiffness: float = 1e8  # N/m; [P] 50 to 200 kN/mm
    pad_damping: float = 2e4  # N s/m; [E]
    pad_length: float = 0.15  # m along the rail; [S] foot of the rail
    sleeper_mass: float = 150.0  # kg, half of a concrete sleeper; [P] 300 kg
    sleeper_inertia: float = 1.2  # kg m2 about y; [E] block of 0.26 x 0.21 m
    outer_stiffness: float = 4e7  # N/m of the ballast below each outer sleeper; [P] 20 to 100 kN/mm
    outer_damping: float = 8e4  # N s/m of the ballast below and beside each outer sleeper, which damps a hanging one, too; [E]
    wheel_load: float = 100e3  # N with the weight of the wheel; [P] axle of 20 t
    wheel_mass: float = 600.0  # kg unsprung; [E]
    contact_stiffness: float = 1.2e9  # N/m of wheel and rail, linear; [P]
    speed: float = 30.0  # m/s
    ramp_time: float = 0.02  # s in which the load is put on and taken off; [E]
    laying_time: float = 0.08  # s in which the pads come under the load of the rail; [E]
    seating_time: float = 0.20  # s before the first wheel, under the weight of the track; [E]
    rest_time: float = 0.04  # s after each wheel; [E]
    share: float = 0.22  # of a rail seat; [G] strip of 0.20 m, sleeper carries on some 0.9 m at a rail seat
    outer_bays: int = 12  # on each side; [G] a rail that is 10 mm higher at one sleeper lifts ten on each side
    run_in_bays: int = 10  # on each side, which the wheel does not pass


class Track:
    """Rail, pads, sleepers and wheel, as a partner of `ballast.couple`.

    Args:
        sleepers: names and positions of the sleepers, at equal distances along x.
        start: time at which the track is laid on the sleepers, s.
        axles: number of wheels that pass, one after the other.
        parameters: parameters of the track.
        heights: height of each sleeper above the line in which the rail is straight, m; default: on it.
    """

    def __init__(self, sleepers, start, axles=1, parameters=None, heights=None):
        self.p = p = parameters or Parameters()
        self.names, self.origins = list(sleepers), np.array(list(sleepers.values()))
        self.start, self.now, self.axles = start, start, axles
        pitch = float(self.origins[1, 0] - self.origins[0, 0])
        self.element = pitch / ELEMENTS_PER_BAY
        self.left = float(self.origins[0, 0]) - p.outer_bays * pitch
        bays = len(self.names) - 1 + 2 * p.outer_bays
        self.nodes = bays * ELEMENTS_PER_BAY + 1
        self.length = bays * pitch
        self.first_sleeper, self.wheel = 2 * self.nodes, 2 * self.nodes + 2 * len(self.names)
        self.run_in = p.run_in_bays * pitch
        self.passing = (self.length - 2 * self.run_in) / p.speed
        self.heights = np.zeros(len(self.names)) if heights is None else np.asarray(heights, dtype=float)
        self._assemble()
        self.q, self.v = np.zeros(self.wheel + 1), np.zeros(self.wheel + 1)
        self.work = dict.fromkeys(("gravity", "wheel load", "traction", "laying", "dampers", "ballast"), 0.0)
        self.trace = np.zeros((0, 0))

    def period(self):
        """Returns the time from one wheel to the next, s."""
        return 2 * self.p.ramp_time + self.passing + self.p.rest_time

    def duration(self):
        """Returns the time of all passages, s."""
        return self.p.seating_time + self.axles * self.period()

    # Protocol of a partner.

    def advance(self, t0, t1, forces):
        wrench = np.stack([forces[name] for name in self.names], axis=1)
        h, rows = (t1 - t0) / len(wrench), []
        for k, row in enumerate(wrench):
            self._step(t0 + k * h, h, row)
            place, load = self.wheel_at(t0 + (k + 0.5) * h)
            rows.append([t0 + (k + 1) * h, place, load, *self.q[self.first_sleeper : self.wheel : 2], *row[:, 2]])
        self.trace = np.array(rows)
        return self.motion()

    def save(self):
        return self.q.copy(), self.v.copy(), dict(self.work)

    def restore(self, state):
        self.q, self.v, self.work = state[0].copy(), state[1].copy(), dict(state[2])

    def motion(self):
        """Returns the motion of the sleepers."""
        rows = {}
        for k, name in enumerate(self.names):
            z, slope = self.q[self.first_sleeper + 2 * k :][:2]
            speed, rate = self.v[self.first_sleeper + 2 * k :][:2]
            rows[name] = np.array([*(self.origins[k] + [0, 0, z]), 0, -slope, 0, 0, 0, speed, 0, -rate, 0])
        return rows

    def wheel_at(self, t):
        """Returns place along x and load of the wheel."""
        p = self.p
        t -= self.start + p.seating_time + self._axle(t) * self.period()
        moved = min(max((t - p.ramp_time) / self.passing, 0.0), 1.0)
        left = self.period() - p.rest_time - t
        load = min(max(min(t, left) / p.ramp_time, 0.0), 1.0)
        return self.left + self.run_in + moved * (self.length - 2 * self.run_in), load * p.share * p.wheel_load

    def energies(self):
        """Returns the work of the drives, energies stored and dissipated since the start, and work on the ballast, J."""
        return {"stored": self.stored_energy(self.now), **self.work}

    def stored_energy(self, t):
        """Returns the kinetic and elastic energy of the current state, J; the time places the wheel."""
        strain, overlap = self.pads @ self.q - self._laid(t), self._contact_shape(self.wheel_at(t)[0]) @ self.q
        sagging = np.minimum(self.q[self.outer], 0.0)
        return 0.5 * float(
            self.v @ self.mass @ self.v + self.q @ self.stiffness @ self.q
            + self.p.share * (self.p.pad_stiffness * strain @ strain + self.outer_spring * sagging @ sagging
                              + self.p.contact_stiffness * overlap**2))  # fmt: skip

    # Dynamics.

    def _step(self, t, h, wrench):
        """Integrates one time step under constant forces of the ballast."""
        if self._axle(t + 0.5 * h) != self._axle(t - 0.5 * h):
            self._next_wheel(t - 0.5 * h, t + 0.5 * h)
        place, load = self.wheel_at(t + 0.5 * h)
        by_ballast = np.zeros(self.wheel + 1)
        by_ballast[self.first_sleeper : self.wheel : 2] = wrench[:, 2]
        # A positive moment about y lowers the side of larger x.
        by_ballast[self.first_sleeper + 1 : self.wheel : 2] = -wrench[:, 4]
        before, after = self._laid(t), self._laid(t + h)
        laid = 0.5 * (before + after)
        force = self.weight + by_ballast + self.pad_forces @ laid
        force[self.wheel] -= load
        shape, wheel_spring = self._contact_shape(place), self.p.share * self.p.contact_stiffness
        stiffness = self.with_pads + wheel_spring * np.outer(shape, shape)
        rest = 2 / h * (self.mass @ self.v) + force - stiffness @ self.q
        left = 2 / h * self.mass + self.damping + 0.5 * h * stiffness
        pressed = self.q[self.outer] < 0.0
        for _ in range(MAX_SUPPORT_ITERATIONS):
            spring = np.zeros(self.wheel + 1)
            spring[self.outer[pressed]] = self.p.share * self.outer_spring
            mean = np.linalg.solve(left + np.diag(0.5 * h * spring), rest - spring * self.q)
            sags = (self.q + 0.5 * h * mean)[self.outer] < 0.0
            if (sags == pressed).all():
                break
            pressed = sags
        else:
            raise RuntimeError("outer sleepers: expected a steady set of pressed springs, found none; use a shorter time step")
        middle, way = self.q + 0.5 * h * mean, h * mean
        # At the end of the step the next wheel may stand on the rail.
        distance = 4 * (place - self.wheel_at(t + 0.25 * h)[0]) if load else 0.0
        self.work["gravity"] += float(self.weight @ way)
        self.work["wheel load"] -= float(load * way[self.wheel])
        self.work["traction"] += float(wheel_spring * (shape @ middle) * (self._contact_shape(place, slope=True) @ middle) * distance)
        self.work["laying"] -= float(self.p.share * self.p.pad_stiffness * (self.pads @ middle - laid) @ (after - before))
        self.work["dampers"] += float(way @ self.damping @ mean)
        self.work["ballast"] -= float(by_ballast @ way)
        self.q, self.v, self.now = self.q + way, 2 * mean - self.v, t + h

    def _axle(self, t):
        return min(max(int((t - self.start - self.p.seating_time) // self.period()), 0), self.axles - 1)

    def _next_wheel(self, before, after):
        """Takes the wheel off the rail and puts the next one where it begins, as deep and as fast as the rail there."""
        stored, old, new = self.stored_energy(before), self._contact_shape(self.wheel_at(before)[0]), self._contact_shape(self.wheel_at(after)[0])
        self.q[self.wheel] += (new - old) @ self.q
        self.v[self.wheel] += (new - old) @ self.v
        self.work["wheel load"] += self.stored_energy(after) - stored

    def _laid(self, t):
        """Returns the compression of the pads at which they carry nothing while the rail is laid, m."""
        x = min(max((t - self.start) / self.p.laying_time, 0.0), 1.0)
        return x * x * (3 - 2 * x) * np.concatenate([self.heights, np.zeros(len(self.names))])

    # Matrices.

    def _assemble(self):
        p, size, a = self.p, self.wheel + 1, self.element
        self.mass, self.stiffness, self.damping = (np.zeros((size, size)) for _ in range(3))
        self.weight = np.zeros(size)
        bending = p.bending_stiffness / a**3 * np.array(
            [[12, 6 * a, -12, 6 * a], [6 * a, 4 * a * a, -6 * a, 2 * a * a],
             [-12, -6 * a, 12, -6 * a], [6 * a, 2 * a * a, -6 * a, 4 * a * a]])  # fmt: skip
        inertia = p.rail_mass * a / 420 * np.array(
            [[156, 22 * a, 54, -13 * a], [22 * a, 4 * a * a, 13 * a, -3 * a * a],
             [54, 13 * a, 156, -22 * a], [-13 * a, -3 * a * a, -22 * a, 4 * a * a]])  # fmt: skip
        for n in range(self.nodes - 1):
            dofs = np.ix_(range(2 * n, 2 * n + 4), range(2 * n, 2 * n + 4))
            self.stiffness[dofs] += bending
            self.mass[dofs] += inertia
            self.weight[2 * n : 2 * n + 4] -= p.rail_mass * GRAVITY * a / 2 * np.array([1, a / 6, 1, -a / 6])
        # Rows: compression of the pads, then their rotation, of which the arm makes a length.
        self.pads, outer = np.zeros((2 * len(self.names), size)), []
        for bay in range(0, self.nodes, ELEMENTS_PER_BAY):
            k = bay // ELEMENTS_PER_BAY - p.outer_bays
            if 0 <= k < len(self.names):
                sleeper = self.first_sleeper + 2 * k
                for row, offset, arm in ((k, 0, 1.0), (k + len(self.names), 1, p.pad_length / math.sqrt(12))):
                    self.pads[row, 2 * bay + offset], self.pads[row, sleeper + offset] = arm, -arm
            else:
                sleeper = 2 * bay
                outer.append(sleeper)
                self.damping[sleeper, sleeper] += p.outer_damping
            self.mass[sleeper, sleeper] += p.sleeper_mass
            self.mass[sleeper + 1, sleeper + 1] += p.sleeper_inertia
            self.weight[sleeper] -= p.sleeper_mass * GRAVITY
        self.damping += p.pad_damping * self.pads.T @ self.pads
        self.outer, self.outer_spring = np.array(outer), 1 / (1 / p.pad_stiffness + 1 / p.outer_stiffness)
        self.mass[self.wheel, self.wheel] += p.wheel_mass
        for matrix in (self.mass, self.stiffness, self.damping, self.weight):
            matrix *= p.share
        # Forces of the pads by their compression, and the stiffness of the track with the pads.
        self.pad_forces = p.share * p.pad_stiffness * self.pads.T
        self.with_pads = self.stiffness + self.pad_forces @ self.pads

    def _contact_shape(self, place, slope=False):
        """Returns the overlap of wheel and rail by the degrees of freedom, or its derivative by the place."""
        n = min(int((place - self.left) / self.element), self.nodes - 2)
        s, a = (place - self.left) / self.element - n, self.element
        shape = np.zeros(self.wheel + 1)
        if slope:
            shape[2 * n : 2 * n + 4] = [6 * s * (s - 1) / a, (1 - s) * (1 - 3 * s), 6 * s * (1 - s) / a, s * (3 * s - 2)]
            return shape
        shape[2 * n : 2 * n + 4] = [1 - 3 * s**2 + 2 * s**3, a * s * (1 - s) ** 2, 3 * s**2 - 2 * s**3, -a * s**2 * (1 - s)]
        shape[self.wheel] = -1.0
        return shape


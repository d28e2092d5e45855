"""Model of a track: a rail on pads and sleepers, and a wheel that passes.

The rail is an Euler-Bernoulli beam of finite elements. Three sleepers stand on the simulated ballast and move in z and about
y; beyond them the rail rests on springs. `Track` is a partner of `ballast.couple`: it integrates rail, sleepers and wheel
by the implicit midpoint rule. The strip of ballast carries a share of one rail seat, by which all stiffnesses, masses and
loads are multiplied. SI units.
"""

from dataclasses import dataclass

import numpy as np

GRAVITY = 9.81
ELEMENTS_PER_BAY = 2


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
    outer_damping: float = 8e4  # N s/m; [E]
    wheel_load: float = 100e3  # N with the weight of the wheel; [P] axle of 20 t
    wheel_mass: float = 600.0  # kg unsprung; [E]
    contact_stiffness: float = 1.2e9  # N/m of wheel and rail, linear; [P]
    speed: float = 30.0  # m/s
    ramp_time: float = 0.02  # s in which the load is put on and taken off; [E]
    seating_time: float = 0.08  # s before the first wheel, under the weight of the track; [E]
    rest_time: float = 0.04  # s after each wheel; [E]
    share: float = 0.22  # of a rail seat; [G] strip of 0.20 m, sleeper carries on some 0.9 m at a rail seat
    outer_bays: int = 4


class Track:
    """Rail, pads, sleepers and wheel, as a partner of `ballast.couple`.

    Args:
        sleepers: names and positions of the sleepers, at equal distances along x.
        start: time at which the track is laid on the sleepers, s.
        axles: number of wheels that pass, one after the other.
        parameters: parameters of the track.
    """

    def __init__(self, sleepers, start, axles=1, parameters=None):
        self.p = p = parameters or Parameters()
        self.names, self.origins = list(sleepers), np.array(list(sleepers.values()))
        self.start, self.axles = start, axles
        pitch = float(self.origins[1, 0] - self.origins[0, 0])
        self.element = pitch / ELEMENTS_PER_BAY
        self.left = float(self.origins[0, 0]) - p.outer_bays * pitch
        bays = len(self.names) - 1 + 2 * p.outer_bays
        self.nodes = bays * ELEMENTS_PER_BAY + 1
        self.length = bays * pitch
        self.first_sleeper, self.wheel = 2 * self.nodes, 2 * self.nodes + 2 * len(self.names)
        self.passing = (self.length - 2 * pitch) / p.speed
        self.run_in = pitch
        self._assemble()
        self.q, self.v = np.zeros(self.wheel + 1), np.zeros(self.wheel + 1)
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
            middle = t0 + (k + 0.5) * h
            place, load = self.wheel_at(middle)
            force = self.weight.copy()
            force[self.wheel] -= load
            force[self.first_sleeper : self.wheel : 2] += row[:, 2]
            # A positive moment about y lowers the side of larger x.
            force[self.first_sleeper + 1 : self.wheel : 2] -= row[:, 4]
            stiffness = self.stiffness.copy()
            shape = self._shape(place)
            stiffness += self.p.share * self.p.contact_stiffness * np.outer(shape, shape)
            left = 2 / h * self.mass + self.damping + 0.5 * h * stiffness
            mean = np.linalg.solve(left, 2 / h * (self.mass @ self.v) + force - stiffness @ self.q)
            self.q, self.v = self.q + h * mean, 2 * mean - self.v
            rows.append([t0 + (k + 1) * h, place, load, *self.q[self.first_sleeper : self.wheel : 2], *row[:, 2]])
        self.trace = np.array(rows)
        return self.motion()

    def save(self):
        return self.q.copy(), self.v.copy()

    def restore(self, state):
        self.q, self.v = (part.copy() for part in state)

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
        t -= self.start + p.seating_time
        axle = min(max(int(t // self.period()), 0), self.axles - 1)
        t -= axle * self.period()
        moved = min(max((t - p.ramp_time) / self.passing, 0.0), 1.0)
        left = self.period() - p.rest_time - t
        load = min(max(min(t, left) / p.ramp_time, 0.0), 1.0)
        return self.left + self.run_in + moved * (self.length - 2 * self.run_in), load * p.share * p.wheel_load

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
        turning = p.pad_length**2 / 12
        for bay in range(0, self.nodes, ELEMENTS_PER_BAY):
            k = bay // ELEMENTS_PER_BAY - p.outer_bays
            if 0 <= k < len(self.names):
                sleeper = self.first_sleeper + 2 * k
                for offset, factor in ((0, 1.0), (1, turning)):
                    pad = np.zeros(size)
                    pad[2 * bay + offset], pad[sleeper + offset] = 1.0, -1.0
                    self.stiffness += factor * p.pad_stiffness * np.outer(pad, pad)
                    self.damping += factor * p.pad_damping * np.outer(pad, pad)
                self.mass[sleeper, sleeper] += p.sleeper_mass
                self.mass[sleeper + 1, sleeper + 1] += p.sleeper_inertia
                self.weight[sleeper] -= p.sleeper_mass * GRAVITY
            else:
                self.stiffness[2 * bay, 2 * bay] += 1 / (1 / p.pad_stiffness + 1 / p.outer_stiffness)
                self.damping[2 * bay, 2 * bay] += p.outer_damping
        self.mass[self.wheel, self.wheel] += p.wheel_mass
        for matrix in (self.mass, self.stiffness, self.damping, self.weight):
            matrix *= p.share

    def _shape(self, place):
        """Returns the overlap of wheel and rail by the degrees of freedom."""
        n = min(int((place - self.left) / self.element), self.nodes - 2)
        s, a = (place - self.left) / self.element - n, self.element
        shape = np.zeros(self.wheel + 1)
        shape[2 * n : 2 * n + 4] = [1 - 3 * s**2 + 2 * s**3, a * s * (1 - s) ** 2, 3 * s**2 - 2 * s**3, -a * s**2 * (1 - s)]
        shape[self.wheel] = -1.0
        return shape


"""Couples the ballast implicitly to a mass on a spring: each window is repeated until both sides agree on the motion.

    python examples/python/implicit_coupling.py [CASE]

The machine is one tine on a spring, pressed into the bed. Explicit coupling, with the force of the last window, would add
energy; repeating the window with a better guess of the motion does not. `ballast.couple` has the schemes.
"""

import sys

import numpy as np

import ballast
from ballast import couple

MASS, STIFFNESS, DAMPING, SPEED = 120.0, 4e5, 4e3, 0.3  # kg, N/m, N s/m, m/s
WINDOW_STEPS, WINDOWS, TOLERANCE_M = 4, 60, 1e-6


class Press:
    """Tine of a mass on a spring, whose upper end moves down."""

    def __init__(self, tine):
        self.name, self.start, self.state = tine.name, tine.start, (0.0, 0.0)

    def advance(self, t0, t1, forces):
        z, v = self.state
        h = (t1 - t0) / len(forces[self.name])
        for k, force in enumerate(forces[self.name][:, 2]):
            spring_end = -SPEED * (t0 + (k + 0.5) * h)
            # Implicit midpoint rule.
            a = MASS / h + DAMPING / 2 + STIFFNESS * h / 4
            b = (MASS / h - DAMPING / 2 - STIFFNESS * h / 4) * v + STIFFNESS * (spring_end - z) + force
            z, v = z + h * (v + b / a) / 2, b / a
        self.state = z, v
        return {self.name: np.array([*(self.start + [0, 0, z]), 0, 0, 0, 0, 0, v, 0, 0, 0])}

    def save(self):
        return self.state

    def restore(self, state):
        self.state = state


case = ballast.Case.load(sys.argv[1] if len(sys.argv) > 1 else "examples/first.toml")
if not {"tines", "tamping"} <= case.to_dict().keys():
    sys.exit(f"{case.name}: expected tines and [tamping], found none")
# Mass and spring belong to the press, so the tines have none.
with ballast.open(case.with_values({"tines.mount": {"rigid": True}})) as sim:
    press = Press(sim.tines[0])
    coupling = couple.Coupling(sim, press, window_steps=WINDOW_STEPS, tolerance=TOLERANCE_M)
    iterations = []
    for _ in range(WINDOWS):
        window = coupling.advance()
        iterations.append(window.iterations)
        force = window.result[press.name].mean_force[2]
        print(f"{window.result.t1_ns * 1e-9:.4f} s  z {press.state[0] * 1e3:7.3f} mm  force {force:8.1f} N  "
              f"iterations {window.iterations}")  # fmt: skip
    print(f"mean passes per window: {np.mean(iterations):.1f}, maximum {max(iterations)}")

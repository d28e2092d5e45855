"""Couples the ballast implicitly to a mass on a spring: each window is repeated until both sides agree on the force.

    python examples/python/implicit_coupling.py [CASE]

The machine is one tine on a spring, pressed into the bed. Explicit coupling, with the force of the last window, would add
energy; repeating the window with a better guess of the motion does not. The force is that on the blade. The shaft and the
blade's own mass (3 of 120 kg) are not part of the machine; `rigid = true` in `[tines.mount]` removes them from the ballast.
"""

import sys

import numpy as np

import ballast

MASS, STIFFNESS, DAMPING = 120.0, 4e5, 4e3  # kg, N/m, N s/m
WINDOW_STEPS, WINDOWS, MAX_PASSES, TOLERANCE_M = 4, 60, 12, 1e-6

with ballast.open(sys.argv[1] if len(sys.argv) > 1 else "examples/first.toml") as sim:
    if not sim.tines:
        sys.exit(f"{sim.case.name}: expected tines and [tamping], found none")
    tine = sim.tines[0]
    h = WINDOW_STEPS * sim.step_ns * 1e-9
    z, v = 0.0, 0.0
    passes = []
    for k in range(WINDOWS):
        spring_end = -0.3 * h * (k + 1)  # upper end of the spring, m
        times = [sim.now_ns, sim.now_ns + WINDOW_STEPS * sim.step_ns]
        guess = z + h * v
        for n in range(1, MAX_PASSES + 1):
            end_velocity = 2 * (guess - z) / h - v  # of the parabola through both ends
            motion = ballast.Motion(
                times,
                [tine.start + [0, 0, z], tine.start + [0, 0, guess]],
                velocities=[[0, 0, v], [0, 0, end_velocity]],
            )
            motions = {tine.name: motion}
            result = sim.advance_to(times[1], motions) if n == 1 else sim.redo(motions)
            if result.status not in ("ok", "warn"):
                sys.exit(f"{times[1] * 1e-9:.4f} s  {result.status}  {result.code}: {result.error_message}")
            force = result[tine.name].mean_force[2]
            # Implicit midpoint rule for the machine, with the force of the ballast.
            a = MASS / h + DAMPING / 2 + STIFFNESS * h / 4
            b = (MASS / h - DAMPING / 2 - STIFFNESS * h / 4) * v + STIFFNESS * (spring_end - z) + force
            change = z + h * (v + b / a) / 2 - guess
            if abs(change) < TOLERANCE_M or n == MAX_PASSES:
                break  # the next window starts at the commanded end of this one
            # Under-relaxation: a stiff bed answers a small displacement with a large force.
            guess += 0.5 * change
        z, v = guess, end_velocity
        passes.append(n)
        print(f"{times[1] * 1e-9:.4f} s  z {z * 1e3:7.3f} mm  force {force:8.1f} N  redone {n - 1} times")
    print(f"mean passes per window: {np.mean(passes):.1f}, maximum {max(passes)}")

"""Couples the ballast to a mass on a spring, implicitly: every window is redone until both agree.

    python examples/python/implicit_coupling.py [CASE]

The machine is one tine on a spring, pressed into the bed. In each window machine and ballast have to agree
on the force between them. Taking the force of the last window instead (explicit coupling) would add
energy; redoing the window with a better guess of the motion does not. The force is that on the blade: what its shaft
and its own mass (3 kg of the 120) do is left out of the machine; `rigid = true` in `[tines.mount]` would leave it out
of the ballast, too.
"""

import sys

import numpy as np

import ballast

MASS, STIFFNESS, DAMPING = 120.0, 4e5, 4e3  # kg, N/m, N s/m: a heavy, stiff machine
WINDOW_STEPS, WINDOWS, MOST, CLOSE = 4, 60, 12, 1e-6  # the last one in m

with ballast.open(sys.argv[1] if len(sys.argv) > 1 else "examples/first.toml") as sim:
    if not sim.tines:
        sys.exit(f"{sim.case.name} has no tines that tamp: it needs tines and [tamping]")
    tine = sim.tines[0]
    h = WINDOW_STEPS * sim.step_ns * 1e-9
    z, v, times = 0.0, 0.0, []
    rounds = []
    for k in range(WINDOWS):
        pulled = -0.3 * h * (k + 1)  # where the upper end of the spring is led, m
        t0 = sim.now_ns
        times = [t0, t0 + WINDOW_STEPS * sim.step_ns]
        guess, out = z + h * v, None
        for n in range(1, MOST + 1):
            rate = 2 * (guess - z) / h - v  # the velocity that a parabola ends with
            motion = ballast.Motion(
                times,
                [tine.start + [0, 0, z], tine.start + [0, 0, guess]],
                velocities=[[0, 0, v], [0, 0, rate]],
            )
            motions = {tine.name: motion}
            out = sim.advance_to(times[1], motions) if n == 1 else sim.redo(motions)
            if out.status not in ("ok", "warn"):
                sys.exit(f"{times[1] * 1e-9:.4f} s  {out.status}  {out.code}: {out.error_message}")  # nothing has moved
            force = out[tine.name].mean_force[2]
            # Machine over the window, by the implicit midpoint rule, with the force of the ballast.
            a = MASS / h + DAMPING / 2 + STIFFNESS * h / 4
            b = (MASS / h - DAMPING / 2 - STIFFNESS * h / 4) * v + STIFFNESS * (pulled - z) + force
            better = z + h * (v + b / a) / 2
            change = better - guess
            if abs(change) < CLOSE or n == MOST:
                break  # the next window begins where this one was told to end
            # Half of the way: a stiff bed answers a small step with a large force.
            guess += 0.5 * change
        z, v = guess, rate
        rounds.append(n)
        print(f"{times[1] * 1e-9:.4f} s  z {z * 1e3:7.3f} mm  force {force:8.1f} N  redone {n - 1} times")
    print(f"{np.mean(rounds):.1f} computations of a window in the mean, at most {max(rounds)}")

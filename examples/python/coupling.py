"""Steps the ballast with a machine of one's own: two tines go down, vibrating, and their forces come back.

    python examples/python/coupling.py [CASE]
"""

import sys

import numpy as np

import ballast

FREQUENCY, AMPLITUDE, SPEED, WINDOW_S = 35.0, 0.003, 0.3, 0.004


def position(tine, t):
    """Where a tine is at time t (s), and how fast: down, and to and fro."""
    angle = 2 * np.pi * FREQUENCY * t
    # From rest: the vibration grows within the first 50 ms.
    grown, growth = (np.sin(10 * np.pi * t) ** 2, 10 * np.pi * np.sin(20 * np.pi * t)) if t < 0.05 else (1.0, 0.0)
    speed = SPEED * grown
    way = SPEED * (t / 2 - np.sin(20 * np.pi * t) / (40 * np.pi)) if t < 0.05 else SPEED * (t - 0.025)
    x = AMPLITUDE * grown * np.sin(angle)
    v = AMPLITUDE * (growth * np.sin(angle) + grown * 2 * np.pi * FREQUENCY * np.cos(angle))
    return tine.start + [tine.direction * x, 0, -way], [tine.direction * v, 0, -speed]


with ballast.open(sys.argv[1] if len(sys.argv) > 1 else "examples/first.toml") as sim:
    if not sim.tines:
        sys.exit(f"{sim.case.name} has no tines that tamp: it needs tines and [tamping]")
    window = max(1, round(WINDOW_S * 1e9 / sim.step_ns)) * sim.step_ns
    while all(sim.save().body(tine.name)[0][2] > tine.full_depth_z for tine in sim.tines):
        t0, t1 = sim.now_ns, sim.now_ns + window
        times = np.arange(t0, t1 + 1, sim.step_ns)
        motions = {}
        for tine in sim.tines:
            x, v = zip(*(position(tine, t * 1e-9) for t in times))
            motions[tine.name] = ballast.Motion(times.tolist(), x, velocities=v)
        out = sim.advance_to(t1, motions)
        if out.status not in ("ok", "warn"):
            # The same window again would end in the same way.
            print(f"{out.t1_ns * 1e-9:.3f} s  {out.status}  {out.code}: {out.error_message}")
            break
        forces = ", ".join(f"{np.linalg.norm(out[name].moving_average_force):6.0f} N" for name in motions)
        print(f"{t1 * 1e-9:.3f} s  {out.status}  {forces}")

"""Couples the ballast to a prescribed machine: two vibrating tines are lowered, and their forces are printed.

    python examples/python/coupling.py [CASE]
"""

import sys

import numpy as np

import ballast

FREQUENCY_HZ, AMPLITUDE_M, SPEED_M_PER_S, WINDOW_S = 35.0, 0.003, 0.3, 0.004
RAMP_S = 0.05


def motion_at(tine, t):
    """Returns the position and velocity of a tine at time t (s): vibration along x, lowering along z."""
    omega = 2 * np.pi * FREQUENCY_HZ
    # Vibration and lowering start from rest and grow along a ramp.
    ramp, ramp_rate, lowered = 1.0, 0.0, SPEED_M_PER_S * (t - 0.5 * RAMP_S)
    if t < RAMP_S:
        rate = np.pi / (2 * RAMP_S)
        ramp = np.sin(rate * t) ** 2
        ramp_rate = rate * np.sin(2 * rate * t)
        lowered = SPEED_M_PER_S * (t / 2 - np.sin(2 * rate * t) / (4 * rate))
    x = AMPLITUDE_M * ramp * np.sin(omega * t)
    v = AMPLITUDE_M * (ramp_rate * np.sin(omega * t) + ramp * omega * np.cos(omega * t))
    return tine.start + [tine.direction * x, 0, -lowered], [tine.direction * v, 0, -SPEED_M_PER_S * ramp]


with ballast.open(sys.argv[1] if len(sys.argv) > 1 else "examples/first.toml") as sim:
    if not sim.tines:
        sys.exit(f"{sim.case.name}: expected tines and [tamping], found none")
    window_ns = max(1, round(WINDOW_S * 1e9 / sim.step_ns)) * sim.step_ns
    while all(sim.save().body(tine.name)[0][2] > tine.full_depth_z for tine in sim.tines):
        t0, t1 = sim.now_ns, sim.now_ns + window_ns
        times = np.arange(t0, t1 + 1, sim.step_ns)
        motions = {}
        for tine in sim.tines:
            x, v = zip(*(motion_at(tine, t * 1e-9) for t in times))
            motions[tine.name] = ballast.Motion(times.tolist(), x, velocities=v)
        result = sim.advance_to(t1, motions)
        if result.status not in ("ok", "warn"):
            # Repeating the window would fail again.
            print(f"{result.t1_ns * 1e-9:.3f} s  {result.status}  {result.code}: {result.error_message}")
            break
        forces = ", ".join(f"{np.linalg.norm(result[name].moving_average_force):6.0f} N" for name in motions)
        print(f"{t1 * 1e-9:.3f} s  {result.status}  {forces}")

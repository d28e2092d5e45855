"""Squeezes until the ballast resists with a preset force, as a controller does.

    python examples/python/squeeze_until_force.py [CASE [FORCE_N]]

The case's tamping cycle lifts and inserts. This program then closes the tines, the slower the closer the force is to the
preset one, and stops when it is reached.
"""

import sys

import numpy as np

import ballast

CASE = sys.argv[1] if len(sys.argv) > 1 else "examples/first.toml"
PRESET_N = float(sys.argv[2]) if len(sys.argv) > 2 else 1500.0
SPEED_M_PER_S, WINDOW_STEPS = 0.15, 5

with ballast.open(CASE) as sim:
    if not sim.tines:
        sys.exit(f"{sim.case.name}: expected tines and [tamping], found none")
    while sim.phase in ("waiting", "lift", "insertion"):
        result = sim.step_tamping_cycle()
        if result.status not in ("ok", "warn"):
            sys.exit(f"{result.t1_ns * 1e-9:.4f} s  {result.status}  {result.code}: {result.error_message}")
    start = {tine.name: sim.save().commanded_pose(tine.name)[0] for tine in sim.tines}
    closing, force, stroke = 0.0, 0.0, min(tine.stroke for tine in sim.tines)
    while force < PRESET_N and closing < stroke:
        t0, t1 = sim.now_ns, sim.now_ns + WINDOW_STEPS * sim.step_ns
        end_closing = closing + SPEED_M_PER_S * max(0.1, 1 - force / PRESET_N) * (t1 - t0) * 1e-9
        motions = {
            tine.name: ballast.Motion(
                [t0, t1], [start[tine.name] + [tine.direction * c, 0, 0] for c in (closing, end_closing)]
            )
            for tine in sim.tines
        }
        result = sim.advance_to(t1, motions)
        if result.status not in ("ok", "warn"):
            sys.exit(f"{t1 * 1e-9:.4f} s  {result.status}  {result.code}: {result.error_message}")
        closing = end_closing
        force = np.mean([abs(result[name].moving_average_force[0]) for name in motions])
        print(f"{t1 * 1e-9:.4f} s  closing {closing * 1e3:5.2f} mm  force {force:6.0f} N")
    print("reached" if force >= PRESET_N else "closed without reaching", f"{PRESET_N:.0f} N")

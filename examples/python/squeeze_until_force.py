"""Squeezes until the ballast pushes back with a preset force: what a controller does.

    python examples/python/squeeze_until_force.py [CASE [FORCE_N]]

The machine of the case lifts and inserts; then this program closes the tines, slower the closer the force is
to the preset one, and stops where it is reached.
"""

import sys

import numpy as np

import ballast

CASE = sys.argv[1] if len(sys.argv) > 1 else "examples/first.toml"
PRESET = float(sys.argv[2]) if len(sys.argv) > 2 else 1500.0
SPEED, WINDOW_STEPS = 0.15, 5

with ballast.open(CASE) as sim:
    if not sim.tines:
        sys.exit(f"{sim.case.name} has no tines that tamp: it needs tines and [tamping]")
    while sim.phase in ("waiting", "lift", "insertion"):
        out = sim.step_tamping_cycle()
        if out.status not in ("ok", "warn"):
            sys.exit(f"{out.t1_ns * 1e-9:.4f} s  {out.status}  {out.code}: {out.error_message}")  # and so it stays
    stopped = {tine.name: sim.save().commanded_pose(tine.name)[0] for tine in sim.tines}
    closed, force, stroke = 0.0, 0.0, min(tine.stroke for tine in sim.tines)
    while force < PRESET and closed < stroke:
        t0, t1 = sim.now_ns, sim.now_ns + WINDOW_STEPS * sim.step_ns
        after = closed + SPEED * max(0.1, 1 - force / PRESET) * (t1 - t0) * 1e-9
        motions = {
            tine.name: ballast.Motion(
                [t0, t1],
                [stopped[tine.name] + [tine.direction * way, 0, 0] for way in (closed, after)],
            )
            for tine in sim.tines
        }
        out = sim.advance_to(t1, motions)
        if out.status not in ("ok", "warn"):
            sys.exit(f"{t1 * 1e-9:.4f} s  {out.status}  {out.code}: {out.error_message}")  # nothing has moved
        closed = after
        force = np.mean([abs(out[name].moving_average_force[0]) for name in motions])
        print(f"{t1 * 1e-9:.4f} s  closed {closed * 1e3:5.2f} mm  force {force:6.0f} N")
    print("reached" if force >= PRESET else "closed without reaching", f"{PRESET:.0f} N")

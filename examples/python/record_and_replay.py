"""Records a run in an MCAP file, replays the file, and ends in the same state, to the bit.

    python examples/python/record_and_replay.py [CASE [FILE]]
"""

import sys

import ballast

CASE = sys.argv[1] if len(sys.argv) > 1 else "examples/first.toml"
FILE = sys.argv[2] if len(sys.argv) > 2 else "runs/recorded.mcap"


def rows(knots, key, names):
    return [[knot[key[0]][key[1]][n] for n in names] for knot in knots]


def motion(asked):
    """A recorded motion as one that can be asked again."""
    knots = asked["knots"]
    hermite = asked["interpolation"] == "hermite"
    return ballast.Motion(
        [knot["time_ns"] for knot in knots],
        rows(knots, ("pose", "position"), "xyz"),
        rows(knots, ("pose", "orientation"), "xyzw"),
        velocities=rows(knots, ("twist", "linear"), "xyz") if hermite else None,
        spins=rows(knots, ("twist", "angular"), "xyz") if hermite else None,
        interpolation=asked["interpolation"],
        rebase=asked["rebase"],
    )


with ballast.open(CASE) as sim:
    sim.record(FILE)
    for _ in range(40):
        sim.step_by_machine()
    sim.stop_recording()
    recorded = sim.save().positions

with ballast.open(CASE) as sim:
    windows = 0
    for window in ballast.read(FILE):
        asked = window["request"]
        sim.advance_to(asked["t1_ns"], {m["body"]: motion(m) for m in asked["motions"]})
        windows += 1
    replayed = sim.save().positions

assert (recorded == replayed).all()
print(f"{windows} windows of {FILE}: the replay ends where the run did, to the bit")

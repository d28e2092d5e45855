"""Records a run in an MCAP file, replays the file, and compares the states bit for bit.

    python examples/python/record_and_replay.py [CASE [FILE]]
"""

import sys

import ballast

CASE = sys.argv[1] if len(sys.argv) > 1 else "examples/first.toml"
FILE = sys.argv[2] if len(sys.argv) > 2 else "runs/recorded.mcap"

with ballast.open(CASE) as sim:
    sim.record(FILE)
    for _ in range(40):
        sim.step_tamping_cycle()
    sim.stop_recording()
    recorded = sim.save().hash

recording = ballast.read(FILE)
with ballast.open(recording.case) as sim:
    windows = 0
    for window in recording:
        sim.advance_to(window["t1_ns"], window["motions"], window["loads"])
        assert sim.save().hash == window["hash"]
        windows += 1
    replayed = sim.save().hash

assert replayed == recorded
print(f"{windows} windows of {FILE}: the replayed state equals the recorded one bit for bit")

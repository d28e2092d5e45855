"""Measures what a live view costs.

    python bindings/python/benchmark_live.py [CASE [ROUNDS [THREADS]]]

The same steps are computed in turn without a view, with a view that writes a file, and with one whose viewer is another
process, with a frame after every tenth step. Zones are measured apart. Every round starts from the same state.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import ballast
import ballast.view

CASE = sys.argv[1] if len(sys.argv) > 1 else "benches/cases/laptop_rigid.toml"
ROUNDS = int(sys.argv[2]) if len(sys.argv) > 2 else 9
THREADS = int(sys.argv[3]) if len(sys.argv) > 3 else None
STEPS, STEPS_OF_FRAME = 40, 10
SERVER = "import rerun, sys; r = rerun.RecordingStream('viewer'); print(r.serve_grpc(grpc_port=19876)); sys.stdin.read()"


def steps(sim, start, shown):
    """Returns wall and processor time of a step, and the time in `update` for each frame, s."""
    sim.restore(start)
    updates = 0.0
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(STEPS):
        sim.advance_to(sim.now_ns + sim.step_ns)
        if shown is not None:
            t = time.perf_counter()
            shown.update()
            updates += time.perf_counter() - t
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return wall / STEPS, cpu / STEPS, updates / STEPS * STEPS_OF_FRAME


def main():
    server = subprocess.Popen([sys.executable, "-uc", SERVER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    with tempfile.TemporaryDirectory() as folder, ballast.open(CASE, threads=THREADS) as sim:
        sim.advance_to(10 * sim.step_ns)
        path, period_s = Path(folder) / "bed.rrd", STEPS_OF_FRAME * sim.step_ns * 1e-9
        views = {
            "no view": None,
            "file": ballast.view.live(sim, path, period_s=period_s),
            "viewer": ballast.view.live(sim, server.stdout.readline().strip(), period_s=period_s),
        }
        start, rows = sim.save(), {name: [] for name in views}
        print(f"{sim.grain_count} grains, {sim.threads} threads, a frame every {STEPS_OF_FRAME} steps")
        names = list(views)
        for turn in range(ROUNDS):
            for name in names[turn % 3 :] + names[: turn % 3]:
                rows[name].append(steps(sim, start, views[name]))
        for name, values in rows.items():
            wall, cpu, update = 1e3 * np.median(values, axis=0)
            print(f"{name:8} step {wall:7.2f} ms wall {cpu:7.2f} ms processor; update {update:6.3f} ms per frame")
        base = np.array(rows["no view"])[:, :2]
        for name in ("file", "viewer"):
            more = np.median((np.array(rows[name])[:, :2] - base) * STEPS_OF_FRAME, axis=0) * 1e3
            print(f"{name:8} {more[0]:+6.2f} ms wall {more[1]:+6.2f} ms processor per frame; {views[name]}")
        frames = views["file"].frames
        views["file"].close()
        print(f"{path.stat().st_size / frames * 1e-3:.0f} kB per frame in the file")
        t = time.perf_counter()
        sim.zones()
        print(f"zones {1e3 * (time.perf_counter() - t):.1f} ms")
        views["viewer"].close()
    server.stdin.close()


if __name__ == "__main__":
    main()

"""Measures what a live view for Foxglove costs a served component.

    python bindings/python/benchmark_foxglove.py [CASE [ROUNDS [THREADS]]]

The same windows of one step are computed in turn without a viewer and with one that reads everything in another process.
Every round starts from the same state.
"""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import ballast

ROOT = Path(__file__).resolve().parents[2]
CASE = sys.argv[1] if len(sys.argv) > 1 else "benches/cases/laptop_rigid.toml"
ROUNDS = int(sys.argv[2]) if len(sys.argv) > 2 else 9
THREADS = sys.argv[3] if len(sys.argv) > 3 else str(os.cpu_count())
WINDOWS, PORT, KEY, ENDPOINT = 50, 18765, "live/bed", "tcp/127.0.0.1:17447"


def cpu_s(process, threads=("",)):
    """Returns the processor time of the threads of a process whose names begin so, s."""
    total = 0.0
    for task in Path(f"/proc/{process.pid}/task").iterdir():
        if (task / "comm").read_text().startswith(threads):
            total += 1e-9 * int((task / "schedstat").read_text().split()[0])
    return total


def windows(sim, start, server):
    """Returns wall time, processor time of the server, and of its threads for viewers, for each window, s."""
    sim.restore(start)

    def clocks():
        return np.array([time.perf_counter(), cpu_s(server), cpu_s(server, ("live view", "tokio-"))])

    before = clocks()
    for _ in range(WINDOWS):
        sim.advance_to(sim.now_ns + sim.step_ns)
    return (clocks() - before) / WINDOWS


def main():
    with tempfile.TemporaryDirectory() as folder:
        command = [ROOT / "target/release/ballast", "serve", CASE, "--key", KEY, "--listen", ENDPOINT, "--out", folder]
        command += ["--threads", THREADS, "--foxglove", str(PORT), "--checkpoint-interval", "100000", "--json"]
        server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert any('"ready"' in line for line in server.stdout)
        rows = {"no viewer": [], "viewer": []}
        with ballast.open(f"zenoh:{KEY}", connect=ENDPOINT) as sim:
            sim.advance_to(10 * sim.step_ns)
            start = sim.save()
            for turn in range(ROUNDS):
                for name in list(rows)[:: 1 if turn % 2 else -1]:
                    viewer = None
                    if name == "viewer":
                        reading = [sys.executable, ROOT / "scripts/foxglove_viewer.py", f"ws://127.0.0.1:{PORT}", "1000000"]
                        viewer = subprocess.Popen(reading)
                        time.sleep(2.0)
                    rows[name].append(windows(sim, start, server))
                    if viewer:
                        viewer.kill()
                        viewer.wait()
                        time.sleep(0.5)
        server.terminate()
        server.wait()
    print(f"{ROUNDS} rounds of {WINDOWS} windows, {THREADS} threads")
    for name, values in rows.items():
        wall, cpu, live = 1e3 * np.median(values, axis=0)
        print(f"{name:10} {wall:7.2f} ms wall, {cpu:7.2f} ms processor, of it {live:5.2f} ms for viewers, for each window")
    more = 1e3 * (np.array(rows["viewer"]) - np.array(rows["no viewer"]))
    [low, middle, high] = np.percentile(more, [25, 50, 75], axis=0)
    for i, name in enumerate(("wall", "processor")):
        print(f"difference {middle[i]:+.2f} ms {name} (quartiles {low[i]:+.2f}, {high[i]:+.2f})")


if __name__ == "__main__":
    main()

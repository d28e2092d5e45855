"""What stepping from Python costs beside computing.

    python bindings/python/benchmarks.py [CASE]

Steps one simulation in windows of one step and another in one window of as many: computed is the same, so the
difference over the number of windows is what a window costs: the call, its checks, the pool of threads, and
the beginning that is kept for `redo`. The latter is what the component does on every face.
"""

import sys
import time

import numpy as np

import ballast

CASE = sys.argv[1] if len(sys.argv) > 1 else "examples/laptop.toml"
STEPS, ROUNDS = 40, 8

with ballast.open(CASE, threads=1) as sim:
    sim.advance_to(10 * sim.step_ns)
    whole, apart, call = [], [], []
    for _ in range(ROUNDS):
        begin, start = sim.save(), sim.now_ns
        t = time.perf_counter()
        sim.advance_to(start + STEPS * sim.step_ns)
        whole.append(time.perf_counter() - t)
        sim.restore(begin)
        t = time.perf_counter()
        for k in range(1, STEPS + 1):
            sim.advance_to(start + k * sim.step_ns)
        apart.append(time.perf_counter() - t)
        t = time.perf_counter()
        for _ in range(1000):
            try:
                sim.advance_to(sim.step_ns + 1)
            except ballast.Refused:
                pass
        call.append((time.perf_counter() - t) / 1000)
    state = sim.save()
    t = time.perf_counter()
    for _ in range(1000):
        state.positions
    view = (time.perf_counter() - t) / 1000
    print(f"{sim.grains} grains, {len(state.contact_bodies)} contact points")
    print(f"a step                     {np.min(whole) / STEPS * 1e3:9.3f} ms")
    print(f"a window of one step, more {(np.min(apart) - np.min(whole)) / STEPS * 1e6:9.1f} us")
    print(f"a refused call             {np.min(call) * 1e6:9.1f} us")
    print(f"all positions              {view * 1e6:9.1f} us")

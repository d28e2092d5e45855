"""What stepping from Python costs beside computing.

    python bindings/python/benchmarks.py [CASE]

Steps in windows of one step. What a window took in the core is told by its outcome; the rest of the call is
Python's: arguments, checks, the way to the pool of threads and back. Another simulation takes as many steps in
one window: what windows of one step take more in the core is mostly the beginning that is kept for `redo`, on
every face.
"""

import sys
import time

import numpy as np

import ballast

CASE = sys.argv[1] if len(sys.argv) > 1 else "examples/laptop.toml"
STEPS, ROUNDS = 40, 8

with ballast.open(CASE, threads=1) as sim:
    sim.advance_to(10 * sim.step_ns)
    whole, apart, beside, call = [], [], [], []
    for _ in range(ROUNDS):
        begin, start = sim.save(), sim.now_ns
        whole.append(sim.advance_to(start + STEPS * sim.step_ns).wall_s)
        sim.restore(begin)
        core = 0.0
        for k in range(1, STEPS + 1):
            t = time.perf_counter()
            out = sim.advance_to(start + k * sim.step_ns)
            beside.append(time.perf_counter() - t - out.wall_s)
            core += out.wall_s
        apart.append(core)
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
    print(f"a call, beside the core    {np.median(beside) * 1e6:9.1f} us")
    print(f"a window of one step, more {(np.min(apart) - np.min(whole)) / STEPS * 1e6:9.1f} us")
    print(f"a refused call             {np.min(call) * 1e6:9.1f} us")
    print(f"all positions              {view * 1e6:9.1f} us")

"""Measures the overhead of stepping from Python.

    python bindings/python/benchmarks.py [CASE [ROUNDS]]

Runs the same steps in turn in windows of one step and in one window. A result has the time that the core needed; the rest of
the call is the overhead of Python: arguments, checks and thread synchronisation. A step leaves cold caches, so that a fixed
reference call (json.dumps) is timed at the same moment, and again after equally long work without the package.
"""

import hashlib
import json
import sys
import time
from threading import Thread

import numpy as np

import ballast

CASE = sys.argv[1] if len(sys.argv) > 1 else "benches/cases/laptop_rigid.toml"
ROUNDS = int(sys.argv[2]) if len(sys.argv) > 2 else 8
STEPS = 40


def reference_call():
    """Returns the time of a fixed call of the standard library, s."""
    t = time.perf_counter()
    json.dumps({"a": 1, "b": [1, 2, 3]})
    return time.perf_counter() - t


def after(work):
    """Returns the median time of the reference call after 20 ms of work, s."""
    took = []
    for _ in range(100):
        begin = time.perf_counter()
        while time.perf_counter() - begin < 0.02:
            work()
        took.append(reference_call())
    return np.median(took)


def measure(threads):
    """Prints the times for a number of threads."""
    with ballast.open(CASE, threads=threads) as sim:
        sim.advance_to(10 * sim.step_ns)
        print(f"{sim.grain_count} grains, {len(sim.save().contact_bodies)} contact points, {threads} thread(s)")
        whole, more, beside, call, others = [], [], [], [], []
        for _ in range(ROUNDS):
            begin, start = sim.save(), sim.now_ns
            t = time.perf_counter()
            sim.advance_to(start + STEPS * sim.step_ns)
            whole.append((time.perf_counter() - t) / STEPS)
            sim.restore(begin)
            apart = 0.0
            for k in range(1, STEPS + 1):
                t = time.perf_counter()
                out = sim.advance_to(start + k * sim.step_ns)
                took = time.perf_counter() - t
                apart += took / STEPS
                beside.append(took - out.wall_time_s)
                others.append(reference_call())
            more.append(apart - whole[-1])
            t = time.perf_counter()
            for _ in range(1000):
                try:
                    sim.advance_to(sim.step_ns + 1)
                except ballast.RequestError:
                    pass
            call.append((time.perf_counter() - t) / 1000)
        state = sim.save()
        t = time.perf_counter()
        for _ in range(1000):
            state.positions
        view = (time.perf_counter() - t) / 1000
    low, middle, high = np.percentile(more, [25, 50, 75]) * 1e6
    print(f"  a step                        {np.median(whole) * 1e3:9.3f} ms")
    print(f"  overhead of a call            {np.median(beside) * 1e6:9.1f} us")
    print(f"  json.dumps at that moment     {np.median(others) * 1e6:9.1f} us")
    print(f"  extra cost of a one-step window {middle:9.1f} us (quartiles {low:.1f} and {high:.1f})")
    print(f"  a refused call                {np.min(call) * 1e6:9.1f} us")
    print(f"  all positions                 {view * 1e6:9.1f} us")


# A separate thread each: a calling thread joins one pool for good.
for threads in (1, 2):
    alone = Thread(target=measure, args=(threads,))
    alone.start()
    alone.join()

numbers = np.zeros(8_000_000)
print("without the package")
for name, work in [
    ("arithmetic alone", lambda: hashlib.pbkdf2_hmac("sha256", b"", b"", 2000)),
    ("additions on 64 MB", lambda: np.add(numbers, 1.0, out=numbers)),
]:
    print(f"  json.dumps after {name:20} {after(work) * 1e6:8.1f} us")

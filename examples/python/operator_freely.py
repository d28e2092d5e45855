"""An operator who cannot be stepped: the tines follow a stick in real-time mode. Stock eclipse-zenoh.

    ballast serve examples/first.toml --key demo/bed
    pip install eclipse-zenoh && python examples/python/operator_freely.py demo/bed 0.02 0.1

The stick lowers the tines by 0.1 m, at 0.02 of the wall clock: a bed of `first` keeps up with that on two cores.
"""
import json, struct, sys, time, uuid, zenoh

if len(sys.argv) < 4:
    sys.exit(__doc__)
key, factor, depth = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
endpoint = sys.argv[4] if len(sys.argv) > 4 else "tcp/127.0.0.1:7447"
config = zenoh.Config()
for name, value in [("mode", "peer"), ("connect/endpoints", [endpoint]), ("listen/endpoints", []),
                    ("scouting/multicast/enabled", False)]:
    config.insert_json5(name, json.dumps(value))
session, base, me, ticket = zenoh.open(config), f"ballast/1/{key}", f"python-{uuid.uuid4().hex[:8]}", ""
token = session.liveliness().declare_token(f"{base}/owner/{me}")  # whose loss stops time
def ask(what, body):
    shown = f"{ticket};{uuid.uuid4().hex}"
    for _ in range(50):  # no reply: not known yet, or lost; asking again with the same number is safe
        for reply in session.get(f"{base}/{what}", payload=json.dumps(body), attachment=shown,
                                 encoding="application/json", timeout=3600.0):
            if reply.ok is None:
                sys.exit(reply.err.payload.to_string())
            return json.loads(reply.ok.payload.to_string())
        time.sleep(0.1)
    sys.exit(f"{key} is not there")
ticket = ask("ctl/attach", {"client": me})["ticket"]  # waits while the bed is prepared
about = ask("describe", {})
tines = [body for body in about["bodies"] if body["role"] == "tine"]
# The last one of each; read here, not called from Zenoh's threads.
felt = {t["name"]: session.declare_subscriber(f"{base}/out/{t['name']}/wrench", zenoh.handlers.RingChannel(1))
        for t in tines}
forces = dict.fromkeys(felt, 0.0)
window = max(1_000_000 // about["step_ns"], 1) * about["step_ns"]
ask("ctl/param", {"real_time": {"real_time_factor": factor, "window_ns": window, "latency_ns": 5 * window,
                                "max_sample_age_ms": 500, "bodies": [t["name"] for t in tines]}})

def stick(t):
    """How deep it is, m, and how fast, m/s, after t seconds of the run: a smooth way within 0.5 s."""
    s = min(max(t / 0.5, 0.0), 1.0)
    return depth * s * s * (3 - 2 * s), depth * 6 * s * (1 - s) / 0.5

begin, last_print = time.monotonic(), time.monotonic()
while (t := factor * (time.monotonic() - begin)) < 0.55:
    way, speed = stick(t)
    for tine in tines:
        at = tine["position"]
        knot = {"time_ns": int(1e9 * t),
                "pose": {"position": {**at, "z": at["z"] - way}, "orientation": tine["orientation"]},
                "twist": {"linear": {"x": 0.0, "y": 0.0, "z": -speed}, "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}}
        session.put(f"{base}/in/{tine['name']}/motion", json.dumps(knot), encoding="application/json", attachment=ticket)
    if time.monotonic() - last_print >= 2.0:
        last_print, status = time.monotonic(), ask("ctl/status", {})
        for name, sample in [(name, wrenches.try_recv()) for name, wrenches in felt.items()]:
            if sample:  # geometry_msgs/WrenchStamped as CDR: force and torque come last
                forces[name] = round(struct.unpack("<6d", sample.payload.to_bytes()[-48:])[2])
        print(f"{status['state']}, {way:.3f} m deep, force upward in N: {forces}", flush=True)
    time.sleep(0.02)
status = ask("ctl/status", {})
ask("ctl/param", {"real_time": None})
run, now = status["real_time"], {body["name"]: body["position"]["z"] for body in ask("describe", {})["bodies"]}
deep = sum(t["position"]["z"] - now[t["name"]] for t in tines) / len(tines)
print(f"{deep:.4f} m deep, the stick {way:.4f}, after {status['seq']} windows; "
      f"{run['overruns']} overruns, {run['dropped_samples']} samples dropped")
ask("ctl/detach", {})
session.close()

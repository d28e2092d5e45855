"""Controls a squeeze until a preset force over Zenoh: eclipse-zenoh and JSON, without the package `ballast`.

    ballast serve examples/first.toml --key demo/bed
    pip install eclipse-zenoh && python examples/python/controller_zenoh.py demo/bed 2000 0.1
"""
import json, sys, time, uuid, zenoh

if len(sys.argv) < 4:
    sys.exit(__doc__)
key, force, depth = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
endpoint = sys.argv[4] if len(sys.argv) > 4 else "tcp/127.0.0.1:7447"
config = zenoh.Config()
for name, value in [("mode", "peer"), ("connect/endpoints", [endpoint]), ("listen/endpoints", []),
                    ("scouting/multicast/enabled", False)]:
    config.insert_json5(name, json.dumps(value))
session, base, me, ticket = zenoh.open(config), f"ballast/1/{key}", f"python-{uuid.uuid4().hex[:8]}", ""
token = session.liveliness().declare_token(f"{base}/owner/{me}")  # whose loss makes the run hold
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
run = ask("ctl/attach", {"client": me})  # waits while the bed is prepared
about = ask("describe", {})
ticket, seq, now = run["ticket"], run["seq"], run["now_ns"]
window = max(1_000_000 // about["step_ns"], 1) * about["step_ns"]
tines = [body for body in about["bodies"] if body["role"] == "tine"]
middle = sum(t["position"]["x"] for t in tines) / len(tines)
start, felt, dt = json.loads(json.dumps(tines)), 0.0, window * 1e-9
for t in tines:
    t["v"], t["in"] = {"x": 0.0, "y": 0.0, "z": 0.0}, 1 if t["position"]["x"] < middle else -1

def knot(t, time_ns):
    return {"time_ns": time_ns, "pose": {"position": dict(t["position"]), "orientation": t["orientation"]},
            "twist": {"linear": dict(t["v"]), "angular": {"x": 0.0, "y": 0.0, "z": 0.0}}}

while True:
    down = start[0]["position"]["z"] - tines[0]["position"]["z"] >= depth
    closing = abs(tines[0]["position"]["x"] - start[0]["position"]["x"])
    done = down and (felt >= force or closing >= 0.04)
    if done and not any(t["v"][axis] for t in tines for axis in "xz"):
        break
    seq, t0, now, motions = seq + 1, now, now + window, []
    for t in tines:
        first, target = knot(t, t0), {"x": t["in"] * 0.1 * (down and not done), "z": -0.5 * (not down)}
        for axis in "xz":  # speeds change by at most 20 m/s²
            faster = min(max(target[axis] - t["v"][axis], -20 * dt), 20 * dt)
            t["position"][axis] += (t["v"][axis] + 0.5 * faster) * dt
            t["v"][axis] += faster
        # the first window stops what an owner that is gone left moving
        motions.append({"body": t["name"], "knots": [first, knot(t, now)], "allow_jump": seq == run["seq"] + 1})
    reply = ask("ctl/advance", {"run_id": run["run_id"], "seq": seq, "t0_ns": t0, "t1_ns": now, "motions": motions})
    if reply["status"] not in ("ok", "warn"):
        sys.exit(f"window {seq}: {reply['status']}, {reply['message']}")
    forces = {b["body"]: b["moving_average"]["force"]["x"] for b in reply["bodies"]}
    felt = sum(-t["in"] * forces[t["name"]] for t in tines) / len(tines)
print(f"{felt:.1f} N after closing {1e3 * closing:.1f} mm, at {now * 1e-9:.3f} s; state {reply['hash']}")
ask("ctl/detach", {})

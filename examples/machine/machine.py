"""Model of a tamping unit: eccentric drive, squeeze cylinders with their supply, arms, insertion drive and cycle logic.

An arm on a pivot carries each tine, so that the blade moves on an arc and tilts. A double-acting cylinder between the upper
end of the arm and the eccentric shaft closes it: the shaft vibrates all cylinders, the oil transmits the vibration to the
arms. A pair of facing tines shares a valve and stops by its own pressure, stroke or time. The unit with all pivots moves
vertically in a cylinder, and from sleeper to sleeper. Pump and accumulator feed all valves.

`TampingUnit` is a partner of `ballast.couple`. Its energies are integrated with its motion, so that the work of the drives
can be compared with what is stored, dissipated and given to the ballast. SI units; pressures are above that of the tank.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

GRAVITY = 9.81
STOP_CAUSES = ("pressure", "stroke", "time")
TRAVEL_TIME = 0.5  # s from one sleeper to the next; an estimate: machines tamp a sleeper in 2 to 4 s


@dataclass(frozen=True)
class Parameters:
    """Parameters of a tamping unit for each two facing tines of a sleeper end.

    Origins: [P] published, [S] standard or catalogue size, [G] geometry of the case or of other parameters, [E] estimate.
    """

    # Eccentric drive.
    frequency: float = 35.0  # Hz; [P] usual in tamping machines
    amplitude: float = 0.004  # m at the blade; [P] 4 to 5 mm
    eccentric_inertia: float = 0.6  # kg m2, with flywheel; [E]
    motor_torque: float = 400.0  # N m, largest; [E] 88 kW at 35 Hz
    motor_gain: float = 20.0  # N m s/rad of the speed controller; [E]
    bearing_damping: float = 0.05  # N m s/rad; [E] 2.4 kW at 35 Hz

    # Arms. The centre of mass is on the pivot.
    lower_length: float = 0.60  # m, pivot to upper edge of the blade; [E] from drawings of units
    upper_length: float = 0.35  # m, pivot to cylinder; [E] from drawings of units
    arm_inertia: float = 6.0  # kg m2 with tine; [E] 17 kg at the blade
    pivot_damping: float = 20.0  # N m s/rad; [E]

    # Squeeze cylinders.
    bore: float = 0.040  # m; [S] ISO 6020-2
    rod: float = 0.022  # m; [S] ISO 6020-2
    cylinder_stroke: float = 0.055  # m; [G] closes a blade by 60 mm, and 20 mm more at the cylinder
    line_volume: float = 1.0e-4  # m3 of hose and dead volume of each chamber; [E]
    bulk_modulus: float = 1.0e9  # Pa of oil with hoses and some air; [E] 1.4e9 for oil alone
    seal_friction: float = 250.0  # N; [E] 2 % of the largest force
    friction_speed: float = 0.01  # m/s at which the friction has 76 % of its value; [E]
    viscous_friction: float = 500.0  # N s/m; [E]
    leakage: float = 1e-13  # m3/(s Pa) across the piston; [E]
    stop_stiffness: float = 5e7  # N/m of the end stops; [E]
    stop_damping: float = 2e4  # N s/m; [E]

    # Squeeze valves, one of each pair.
    valve_flow: float = 6.0e-5  # m3/s at 35 bar per edge and cylinder; [E] 3.6 l/min, closes 60 mm in 0.4 s without load
    check_flow: float = 4.0e-4  # m3/s at 35 bar of the check valves to the tank; [E]
    valve_time: float = 0.008  # s; [E] catalogues of proportional valves: 5 to 20 ms
    relief_pressure: float = 210e5  # Pa of each chamber; [E]
    relief_gain: float = 2e-10  # m3/(s Pa) above that pressure; [E]
    sensor_time: float = 0.020  # s, each of two filters in series; [E] leaves 5 % of the vibration
    preset_pressure: float = 110e5  # Pa of the load at which a pair stops; [P] 115 to 125 bar, 8 kN at the blade

    # Supply.
    supply_pressure: float = 150e5  # Pa; [E]
    pump_flow: float = 3.0e-3  # m3/s, largest; [E] 180 l/min
    pump_gain: float = 1e-9  # m3/(s Pa) of the pressure controller; [E]
    accumulator: float = 1.8e-10  # m3/Pa; [G] 4 l of gas with 100 bar at 150 bar

    # Insertion drive of the unit.
    unit_mass: float = 450.0  # kg with arms; [E]
    insertion_area: float = 2.0e-3  # m2; [S] bore 63 mm, rod 36 mm, the smaller side
    insertion_volume: float = 1.2e-3  # m3 of both chambers; [G] stroke 0.5 m, and lines
    insertion_flow: float = 1.6e-3  # m3/s at 35 bar; [E]
    insertion_valve_time: float = 0.012  # s; [E]
    insertion_pressure: float = 80e5  # Pa of the reducing valve; [E] 16 kN and the weight: 5 kN per tine
    insertion_gain: float = 12.0  # 1/s of the position controller; [E]
    insertion_friction: float = 400.0  # N; [E]

    # Cycle; those of the case replace the values here.
    lift_height: float = 0.020  # m; [P] 20 to 30 mm
    lift_time: float = 0.15  # s; [E]
    insertion_time: float = 0.35  # s; [E] 0.3 to 0.5 s
    insertion_limit: float = 0.60  # s, after which the squeeze starts at any depth; [E]
    depth_tolerance: float = 0.008  # m above full depth at which the squeeze starts; [E]
    squeeze_time: float = 0.80  # s, longest; [P] 0.6 to 1.2 s
    closing_limit: float = 0.060  # m at the blade; [G] gap to the sleeper less amplitude and a clearance
    hold_time: float = 0.05  # s; [E]
    withdrawal_time: float = 0.30  # s; [E] 0.3 to 0.5 s

    @classmethod
    def of_case(cls, case, **others):
        """Returns the parameters with the cycle of a case; `others` are set by name."""
        tamping = case.to_dict().get("tamping", {})
        places = {"frequency": ("vibration", "frequency_Hz"), "amplitude": ("vibration", "amplitude_m"),
                  "lift_height": ("lift", "height_m"), "lift_time": ("lift", "duration_s"),
                  "insertion_time": ("insertion", "duration_s"), "squeeze_time": ("squeeze", "duration_s"),
                  "closing_limit": ("squeeze", "stroke_m")}  # fmt: skip
        found = {name: tamping[a][b] for name, (a, b) in places.items() if b in tamping.get(a, {})}
        for name, key in {"hold_time": "hold_s", "withdrawal_time": "withdrawal_s"}.items():
            if key in tamping:
                found[name] = tamping[key]
        return cls(**(found | others))

    def piston_area(self):
        return 0.25 * math.pi * self.bore**2

    def rod_area(self):
        """Area of the ring around the rod, m2."""
        return 0.25 * math.pi * (self.bore**2 - self.rod**2)

    def eccentricity(self):
        """Eccentricity of the shaft that gives the amplitude at the blade, m."""
        return self.amplitude * self.upper_length / self.lower_length


#: Columns of `TampingUnit.trace`, one row for each time step.
TRACE = ("time", "depth", "speed", "supply", "insertion", "frequency")
#: Columns of the trace for each arm, and for each pair of tines.
ARM_TRACE = ("closing", "angle", "pressure", "force", "piston")
PAIR_TRACE = ("load_pressure", "spool")


@dataclass(frozen=True)
class Station:
    """Place of the unit: the tines that its arms carry there (`sim.tines`), name and position of the lifted sleeper."""

    tines: list
    sleeper: str
    position: tuple

    def pairs(self):
        """Returns the numbers of the pairs."""
        return sorted({tine.pair for tine in self.tines})


class TampingUnit:
    """Tamping unit above one sleeper, or above several in turn, as a partner of `ballast.couple`.

    The case has the tines at each sleeper. Those of the sleeper at which the unit is move with it; the others wait above the
    ballast and vibrate there.

    Args:
        stations: places of the unit in turn, each with the same number of tines.
        step: time step of the simulation, s. Controller and forces of the ballast are constant in it.
        parameters: parameters of the unit.
        pairs_by_cycle: the pairs of a station, counted from 0, that squeeze in each cycle there; default: one cycle of all.
        is_loaded: False: the unit does not feel the ballast, so that its motion is imposed.
        start: time at which the cycle starts, s.
    """

    def __init__(self, stations, step, parameters=None, pairs_by_cycle=None, is_loaded=True, start=0.0):
        self.p = p = parameters or Parameters()
        self.stations, self.is_loaded, tines = stations, is_loaded, stations[0].tines
        self.names = [tine.name for station in stations for tine in station.tines]
        self.signs = [float(tine.direction) for tine in tines]
        self.travel = max(tine.start[2] - tine.full_depth_z for tine in tines)
        pairs = stations[0].pairs()
        self.pair_list = [pairs.index(tine.pair) for tine in tines]
        self.pair_of = np.array(self.pair_list)
        self.arms_of = np.bincount(self.pair_of).tolist()
        self.step = step
        cycles = [set(cycle) for cycle in (pairs_by_cycle or [range(len(pairs))])]
        self.cycles = [(station, cycle) for station in range(len(stations)) for cycle in cycles]
        n, m = len(tines), len(pairs)
        sizes = {"z": 1, "vz": 1, "p_ins": 1, "s_ins": 1, "theta": 1, "omega": 1, "p_s": 1,
                 "phi": n, "dphi": n, "pa": n, "pb": n, "spool": m, "sensor_1": m, "sensor_2": m,
                 "pump": 1, "motor": 1, "throttle": 1, "friction": 1, "leak": 1, "tines": 1}  # fmt: skip
        self.at, end = {}, 0
        for name, size in sizes.items():
            self.at[name] = slice(end, end + size) if size > 1 or name in ("spool", "sensor_1", "sensor_2") else end
            end += size
        self.y = np.zeros(end)
        self.y[self.at["p_s"]] = p.supply_pressure
        self.y[self.at["p_ins"]] = -p.unit_mass * GRAVITY / p.insertion_area
        self.y[self.at["pb"]] = p.supply_pressure
        self.area_a, self.area_b = p.piston_area(), p.rod_area()
        self.valve, self.check = p.valve_flow / math.sqrt(35e5), p.check_flow / math.sqrt(35e5)
        needed = p.closing_limit * p.upper_length / p.lower_length
        if needed > p.cylinder_stroke:
            raise ValueError(f"cylinder_stroke: expected at least {needed:.3f} m for the closing limit of {p.closing_limit} m, "
                             f"found {p.cylinder_stroke} m")  # fmt: skip
        self.chamber_a, self.chamber_b = (p.line_volume + 0.5 * area * p.cylinder_stroke for area in (self.area_a, self.area_b))
        # The oil presses the open pistons onto their stops by this overlap.
        self.seat = p.supply_pressure * p.rod_area() / p.stop_stiffness
        self.logic = {"time": start, "cycle": 0, "phase": "lift", "since": start, "stops": [None] * m, "lifting": 0.0,
                      "lifted": [start] + [math.inf] * (len(stations) - 1), "squeezes": []}  # fmt: skip
        self.trace = np.zeros((0, len(TRACE) + len(ARM_TRACE) * n + len(PAIR_TRACE) * m))
        self.stored_at_start = sum(self.stored().values())

    # Protocol of a partner.

    def advance(self, t0, t1, forces):
        """Advances the unit; forces of the ballast and commands of the controller are constant in each time step."""
        wrench = sum(np.stack([forces[tine.name] for tine in station.tines], axis=1) for station in self.stations)
        # Forces along x and z, and the torque about y.
        loads = (wrench[:, :, [0, 2, 4]] * self.is_loaded).tolist()
        rows, steps = [], len(wrench)
        for k in range(steps):
            a, b = t0 + (t1 - t0) * k / steps, t0 + (t1 - t0) * (k + 1) / steps
            command = self._control(a)
            solution = solve_ivp(self._rates, (a, b), self.y, "RK45", rtol=1e-5, atol=self._tolerances(),
                                 args=(loads[k], command))  # fmt: skip
            self.y = solution.y[:, -1]
            self.logic["time"] = b
            for number, station in enumerate(self.stations):
                self.logic["lifting"] -= forces[station.sleeper][k, 2] * (self._sleeper_lift(number, b)[0] - self._sleeper_lift(number, a)[0])
            rows.append(self._trace_row(b, wrench[k]))
        self.trace = np.array(rows)
        return self.motion()

    def save(self):
        logic = {key: list(value) if isinstance(value, list) else value for key, value in self.logic.items()}
        return {"y": self.y.copy(), "logic": logic, "stored_at_start": self.stored_at_start}

    def restore(self, state):
        self.y, self.stored_at_start = state["y"].copy(), state["stored_at_start"]
        self.logic = {key: list(value) if isinstance(value, list) else value for key, value in state["logic"].items()}

    # Kinematics.

    def motion(self):
        """Returns the motion of the blades and of the lifted sleeper."""
        v, rows = self._get(self.y), {}
        for number, station in enumerate(self.stations):
            is_here = number == self.station
            z, vz = (v["z"], v["vz"]) if is_here else (0.0, 0.0)
            for i, tine in enumerate(station.tines):
                # A positive turn about y moves what is below the pivot towards -x.
                turn, rate = -self.signs[i] * v["phi"][i], -self.signs[i] * v["dphi"][i]
                x, below = self._tip(i, v["phi"][i])
                position = tine.start + np.array([x, 0.0, below + self.p.lower_length + z])
                rows[tine.name] = np.array([*position, 0, turn, 0, rate * below, 0, vz - rate * x, 0, rate, 0])
            height, speed = self._sleeper_lift(number, self.logic["time"])
            place = np.asarray(station.position, dtype=float) + [0, 0, height]
            rows[station.sleeper] = np.array([*place, 0, 0, 0, 0, 0, speed, 0, 0, 0])
        return rows

    def _tip(self, i, phi):
        """Returns the blade of an arm relative to its pivot: x and z."""
        return self.signs[i] * self.p.lower_length * math.sin(phi), -self.p.lower_length * math.cos(phi)

    def _piston(self, v):
        """Returns the way of each piston from the stop of the open tines, m."""
        return self.p.upper_length * v["phi"] - self.p.eccentricity() * math.sin(v["theta"]) - self.seat

    def _sleeper_lift(self, station, t):
        """Returns height and speed of the sleeper of a station."""
        x = min(max((t - self.logic["lifted"][station]) / self.p.lift_time, 0.0), 1.0)
        rate = 6 * x * (1 - x) / self.p.lift_time
        return self.p.lift_height * x * x * (3 - 2 * x), self.p.lift_height * rate

    def closing(self):
        """Returns the closing of each blade, m."""
        return self.p.lower_length * np.sin(self.y[self.at["phi"]])

    def closing_by_cylinder(self):
        """Returns the closing of each blade without the vibration, m, as a sensor on its cylinder measures it."""
        extension = self._piston(self._get(self.y)) + self.seat
        return self.p.lower_length * np.sin(extension / self.p.upper_length)

    # Cycle logic.

    @property
    def phase(self):
        return self.logic["phase"]

    @property
    def station(self):
        """Number of the station at which the unit is, or to which it travels."""
        return self.cycles[self.logic["cycle"]][0]

    def _control(self, t):
        """Advances the cycle and returns the commands: insertion spool, spools of the pairs, speed of the eccentric."""
        p, logic, get = self.p, self.logic, self._get(self.y)
        age, squeezing = t - logic["since"], self.cycles[logic["cycle"]][1]
        if logic["phase"] == "lift" and age >= p.lift_time - 1e-9:
            self._enter("insertion", t)
        elif logic["phase"] == "insertion":
            if -get["z"] > self.travel - p.depth_tolerance or age >= p.insertion_limit:
                self._enter("squeeze", t)
                logic["stops"] = [None if pair in squeezing else "idle" for pair in range(len(logic["stops"]))]
        elif logic["phase"] == "squeeze":
            self._stop_pairs(t, age, get)
            if None not in logic["stops"]:
                self._enter("hold", t)
        elif logic["phase"] == "hold" and age >= p.hold_time:
            self._enter("withdrawal", t)
        elif logic["phase"] == "withdrawal" and -get["z"] < 0.01 and age >= p.withdrawal_time:
            if logic["cycle"] + 1 == len(self.cycles):
                self._enter("done", t)
            elif self.cycles[logic["cycle"] + 1][0] != self.station:
                self._enter("travel", t)
            else:
                logic["cycle"] += 1
                self._enter("insertion", t)
        elif logic["phase"] == "travel" and age >= TRAVEL_TIME:
            logic["cycle"] += 1
            logic["lifted"][self.station] = t
            self._enter("lift", t)
        phase, age = logic["phase"], t - logic["since"]
        spools = np.full(len(logic["stops"]), -1.0)
        if phase == "squeeze":
            spools = np.array([{None: 1.0, "idle": -1.0}.get(stop, 0.0) for stop in logic["stops"]])
        elif phase == "hold":
            spools = np.array([-1.0 if stop == "idle" else 0.0 for stop in logic["stops"]])
        target, speed = self._depth(phase, age)
        flow = p.insertion_area * (speed + p.insertion_gain * (target + get["z"]))
        spool = flow / (p.insertion_flow * math.sqrt(p.insertion_pressure / 35e5))
        return float(min(max(spool, -1.0), 1.0)), spools.tolist(), 0.0 if phase == "done" else 2 * math.pi * p.frequency

    def _enter(self, phase, t):
        self.logic["phase"], self.logic["since"] = phase, t

    def _depth(self, phase, age):
        """Returns the commanded depth of the unit and its rate."""
        if phase in ("lift", "travel", "done"):
            return 0.0, 0.0
        if phase in ("squeeze", "hold"):
            return self.travel, 0.0
        duration = self.p.insertion_time if phase == "insertion" else self.p.withdrawal_time
        x = min(age / duration, 1.0)
        depth, speed = self.travel * x * x * (3 - 2 * x), self.travel * 6 * x * (1 - x) / duration
        return (depth, speed) if phase == "insertion" else (self.travel - depth, -speed)

    def _stop_pairs(self, t, age, get):
        closing = self.closing_by_cylinder()
        for k, stop in enumerate(self.logic["stops"]):
            if stop is not None:
                continue
            closed, pressure = float(closing[self.pair_of == k].mean()), float(get["sensor_2"][k])
            reached = (pressure >= self.p.preset_pressure, closed >= self.p.closing_limit, age >= self.p.squeeze_time)
            if any(reached):
                self.logic["stops"][k] = cause = STOP_CAUSES[reached.index(True)]
                station = self.stations[self.station]
                self.logic["squeezes"].append({
                    "cycle": self.logic["cycle"] + 1, "pair": station.pairs()[k], "sleeper": station.sleeper, "time": t,
                    "cause": cause, "closing": closed, "pressure": pressure,
                })  # fmt: skip

    # Dynamics.

    def _get(self, y):
        return {name: y[place] for name, place in self.at.items()}

    def _tolerances(self):
        """Returns absolute tolerances of the integration: pressures are in Pa, energies in J."""
        tolerance = np.full(len(self.y), 1e-8)
        for name in ("p_ins", "p_s", "pa", "pb", "sensor_1", "sensor_2"):
            tolerance[self.at[name]] = 10.0
        for name in ("pump", "motor", "throttle", "friction", "leak", "tines"):
            tolerance[self.at[name]] = 1e-3
        return tolerance

    def _rates(self, t, y, wrench, command):
        """Returns the rates of the state. Plain numbers are several times faster here than short arrays."""
        p, at = self.p, self.at
        y, out = y.tolist(), [0.0] * len(y)
        insertion_command, spool_command, speed_command = command
        theta, omega, supply = y[at["theta"]], y[at["omega"]], y[at["p_s"]]
        eccentricity = p.eccentricity()
        swing = eccentricity * math.cos(theta)
        area_a, area_b = self.area_a, self.area_b
        used = throttled = rubbed = leaked = given = load = 0.0
        pressures = [0.0] * len(self.arms_of)

        for i, pair in enumerate(self.pair_list):
            phi, dphi, pa, pb = (y[at[name].start + i] for name in ("phi", "dphi", "pa", "pb"))
            spool = y[at["spool"].start + pair]
            # Cylinder between arm and eccentric shaft.
            piston = p.upper_length * phi - eccentricity * math.sin(theta) - self.seat
            speed = p.upper_length * dphi - swing * omega
            friction = p.seal_friction * math.tanh(speed / p.friction_speed) + p.viscous_friction * speed
            stop, overlap = self._end_stop(piston, speed)
            force = pa * area_a - pb * area_b + stop - friction
            load -= force * swing
            # Arm on its pivot; force and torque of the ballast at the blade.
            x, z = self._tip(i, phi)
            fx, fz, my = wrench[i]
            by_ballast = -self.signs[i] * (fx * z - fz * x + my)
            out[at["phi"].start + i] = dphi
            out[at["dphi"].start + i] = (p.upper_length * force + by_ballast - p.pivot_damping * dphi) / p.arm_inertia
            # Oil of both chambers; check valves let oil in from the tank where a chamber grows faster than its flow.
            opened, closed = self.valve * max(spool, 0.0), self.valve * max(-spool, 0.0)
            to_a, from_a = opened * _root(supply - pa), closed * _root(pa)
            to_b, from_b = closed * _root(supply - pb), opened * _root(pb)
            leak = p.leakage * (pa - pb)
            out_a = p.relief_gain * max(pa - p.relief_pressure, 0.0) - self.check * _root(max(-pa, 0.0))
            out_b = p.relief_gain * max(pb - p.relief_pressure, 0.0) - self.check * _root(max(-pb, 0.0))
            out[at["pa"].start + i] = p.bulk_modulus / self.chamber_a * (to_a - from_a - area_a * speed - leak - out_a)
            out[at["pb"].start + i] = p.bulk_modulus / self.chamber_b * (to_b - from_b + area_b * speed + leak - out_b)
            pressures[pair] += (pa - pb * area_b / area_a) / self.arms_of[pair]
            # Power.
            used += to_a + to_b
            throttled += (supply - pa) * to_a + pa * from_a + (supply - pb) * to_b + pb * from_b
            rubbed += friction * speed - (stop + p.stop_stiffness * overlap) * speed + p.pivot_damping * dphi * dphi
            leaked += leak * (pa - pb) + pa * out_a + pb * out_b
            given -= by_ballast * dphi

        for pair, pressure in enumerate(pressures):
            first = y[at["sensor_1"].start + pair]
            out[at["sensor_1"].start + pair] = (pressure - first) / p.sensor_time
            out[at["sensor_2"].start + pair] = (first - y[at["sensor_2"].start + pair]) / p.sensor_time
            out[at["spool"].start + pair] = (spool_command[pair] - y[at["spool"].start + pair]) / p.valve_time

        # Eccentric shaft.
        torque = min(max(p.motor_gain * (speed_command - omega), -p.motor_torque), p.motor_torque)
        out[at["theta"]] = omega
        out[at["omega"]] = (torque + load - p.bearing_damping * omega) / p.eccentric_inertia

        # Insertion cylinder: positive spool and pressure lower the unit.
        spool, pressure, speed = y[at["s_ins"]], y[at["p_ins"]], y[at["vz"]]
        sign = 1.0 if spool >= 0.0 else -1.0
        available = min(supply, p.insertion_pressure) if sign > 0.0 else supply
        flow = p.insertion_flow / math.sqrt(35e5) * abs(spool) * _root(available - sign * pressure)
        lift = sum(force[1] for force in wrench)
        rail = p.insertion_friction * math.tanh(speed / p.friction_speed)
        oil = sign * flow + p.insertion_area * speed - p.leakage * pressure
        out[at["p_ins"]] = oil * 4 * p.bulk_modulus / p.insertion_volume
        out[at["s_ins"]] = (insertion_command - spool) / p.insertion_valve_time
        out[at["z"]] = speed
        out[at["vz"]] = (lift - p.insertion_area * pressure - rail) / p.unit_mass - GRAVITY

        # Pump and accumulator.
        pumped = min(max(p.pump_gain * (p.supply_pressure - supply), 0.0), p.pump_flow)
        out[at["p_s"]] = (pumped - used - flow) / p.accumulator

        # Energies.
        out[at["pump"]] = pumped * supply
        out[at["motor"]] = torque * omega
        out[at["throttle"]] = throttled + (supply - sign * pressure) * flow
        out[at["friction"]] = rubbed + p.bearing_damping * omega * omega + rail * speed
        out[at["leak"]] = leaked + p.leakage * pressure * pressure
        out[at["tines"]] = given - lift * speed
        return out

    def _end_stop(self, piston, speed):
        """Returns the force of the end stops on a piston, and the overlap: negative at the stop of the open tines."""
        p = self.p
        if piston < 0.0:
            return max(-p.stop_stiffness * piston - p.stop_damping * speed, 0.0), piston
        over = piston - p.cylinder_stroke
        if over > 0.0:
            return -max(p.stop_stiffness * over + p.stop_damping * speed, 0.0), over
        return 0.0, 0.0

    # Energies and trace.

    def stored(self):
        """Returns the stored energies, J."""
        p, v = self.p, self._get(self.y)
        piston = self._piston(v)
        overlap = np.minimum(piston, 0.0) + np.maximum(piston - p.cylinder_stroke, 0.0)
        return {
            "kinetic": 0.5 * float(p.unit_mass * v["vz"] ** 2 + p.arm_inertia * (v["dphi"] ** 2).sum()
                                   + p.eccentric_inertia * v["omega"] ** 2),
            "potential": float(p.unit_mass * GRAVITY * v["z"]),
            "oil": 0.5 / p.bulk_modulus * float(self.chamber_a * (v["pa"] ** 2).sum()
                                                + self.chamber_b * (v["pb"] ** 2).sum()
                                                + 0.25 * p.insertion_volume * v["p_ins"] ** 2),
            "accumulator": 0.5 * p.accumulator * float(v["p_s"]) ** 2,
            "stops": 0.5 * p.stop_stiffness * float((overlap**2).sum()),
        }  # fmt: skip

    def energies(self):
        """Returns the work of the drives, energies stored and dissipated since the start, and work on the ballast, J."""
        v, lifting = self._get(self.y), self.logic["lifting"]
        return {
            "pump": float(v["pump"]), "eccentric motor": float(v["motor"]), "lifting drive": lifting,
            "stored": sum(self.stored().values()) - self.stored_at_start,
            "valves": float(v["throttle"]), "friction": float(v["friction"]), "leakage and relief": float(v["leak"]),
            "tines": float(v["tines"]),
        }  # fmt: skip

    def _trace_row(self, t, wrench):
        v = self._get(self.y)
        load = v["pa"] - v["pb"] * self.area_b / self.area_a
        arms = [self.closing(), v["phi"], load, -np.array(self.signs) * wrench[:, 0], self._piston(v)]
        return np.concatenate([[t, -v["z"], -v["vz"], v["p_s"], v["p_ins"], v["omega"] / (2 * math.pi)],
                               *arms, v["sensor_2"], v["spool"]])  # fmt: skip


def _root(pressure):
    """Signed square root of a pressure difference, linear below 1 bar."""
    return pressure / math.sqrt(math.sqrt(pressure * pressure + 1e10))

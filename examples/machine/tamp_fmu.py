"""Tamps the bed of a co-simulation unit (FMU) with the tamping unit of this folder, through FMPy.

    ballast export fmu examples/machine/tamping.toml -o tamping.fmu
    python examples/machine/tamp_fmu.py tamping.fmu --window 1 --out runs/fmu

Options are those of `tamp.py`, with the co-simulation unit in place of the case. `UnitSimulation` has the methods that
`ballast.couple` calls, made of functions of FMI, so that schemes and tamping unit stay as they are. Windows of one time step
give the bytes of `tamp.py --window 1`. In longer windows the tamping unit feels mean forces, since the outputs of a
co-simulation unit are means over the communication step. Needs FMPy (`pip install fmpy`).
"""

import tempfile
import weakref
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import ballast
import fmpy
import numpy as np
import tamp
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu

#: Status of a call that had no effect.
DISCARD = 2
#: Inputs of a body: quantities and numbers of elements.
MOTION = {"position": 3, "orientation": 4, "velocity": 3, "angular_velocity": 3}


class UnitState:
    """State that a co-simulation unit saved; it is freed there with its last reference."""

    def __init__(self, unit):
        self.unit, self.time_ns, self.handle = unit, unit.now_ns, unit.fmu.getFMUState()
        unit.handles.append(self.handle)
        weakref.finalize(self, unit.free, self.handle)

    def _read(self, read, *arguments):
        """Returns a value that the unit has in this state."""
        present = UnitState(self.unit)
        self.unit.restore(self)
        value = read(*arguments)
        self.unit.restore(present)
        return value

    @property
    def hash(self):
        return _text(self._read(self.unit.read, "state_hash"))

    def commanded_pose(self, body):
        return [self._read(self.unit.read, f"{body}.{quantity}", MOTION[quantity]) for quantity in ("position", "orientation")]

    def commanded_twist(self, body):
        return [self._read(self.unit.read, f"{body}.{quantity}", MOTION[quantity]) for quantity in ("velocity", "angular_velocity")]


@dataclass
class UnitResult:
    """Result of a window: a mapping from the names of bodies to work (J) and position (m), as `ballast.WindowResult`."""

    status: str
    t1_ns: int
    steps: int = 0
    bodies: dict | None = None
    solver: SimpleNamespace | None = None
    step_series: SimpleNamespace | None = None
    code: str | None = None
    error_message: str | None = None

    def __getitem__(self, name):
        return self.bodies[name]


class UnitSimulation:
    """Co-simulation unit with the methods of `ballast.Simulation` that a coupling needs.

    The inputs of the unit hold at the end of a step, so that its motion is the cubic that `ballast.couple` commands.

    Args:
        path: unit of a case with rows of tines (`[tines]`) and `[tamping]`, for FMI 2.0 or 3.0.
        threads: computing threads; default: one for each processor.
    """

    def __init__(self, path, threads=None):
        self.folder = tempfile.TemporaryDirectory()
        fmpy.extract(path, self.folder.name)
        description = fmpy.read_model_description(path)
        self.variables = {variable.name: variable for variable in description.modelVariables}
        self.messages = []
        self.fmu = instantiate_fmu(self.folder.name, description, "CoSimulation",
                                   logger=lambda *values: self.messages.append(_text(values[-1])))  # fmt: skip
        self.write("threads", threads or 0)
        if description.fmiVersion == "2.0":
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.case = ballast.Case.load(Path(self.folder.name) / "resources/case.toml")
        self.step_ns, self.now_ns, self.start, self.handles = self.case.step_ns, 0, None, []
        self.bodies = [name.split(".")[0] for name in self.variables if name.endswith(".force[1]")]
        self.mounts = [name for name in self.bodies if f"{name}.body_position[1]" in self.variables]
        self.roles = {name: name.split("_")[0] for name in self.bodies}
        self.tines = [self._tine(name) for name in self.bodies if self.roles[name] == "tine"]

    def __enter__(self):
        return self

    def __exit__(self, *error):
        for handle in list(self.handles):
            self.free(handle)
        self.fmu.terminate()
        self.fmu.freeInstance()
        self.folder.cleanup()

    def save(self):
        return UnitState(self)

    def restore(self, state):
        self.fmu.setFMUState(state.handle)
        self.now_ns = state.time_ns

    def free(self, handle):
        if handle in self.handles:
            self.handles.remove(handle)
            self.fmu.freeFMUState(handle)

    def advance_to(self, t1_ns, motions, *, record_steps=True):
        """Advances the unit in one communication step."""
        self.start, self.end_ns = self.save(), t1_ns
        return self._step(motions)

    def redo(self, motions, *, record_steps=True):
        """Computes the last step again with other inputs."""
        self.restore(self.start)
        return self._step(motions)

    def _step(self, motions):
        t0, h = self.now_ns * 1e-9, (self.end_ns - self.now_ns) * 1e-9
        self.messages.clear()
        try:
            for body, motion in motions.items():
                (_, positions, orientations), twists = motion.__getnewargs_ex__()
                ends = [positions[-1], orientations[-1], twists["velocities"][-1], twists["angular_velocities"][-1]]
                for quantity, values in zip(MOTION, ends, strict=True):
                    self.write(f"{body}.{quantity}", values)
            self.fmu.doStep(t0, h)
        except FMICallException as fault:
            if fault.status != DISCARD:
                raise
            self.restore(self.start)
            return UnitResult("discard", self.now_ns, code="discard", error_message=" ".join(self.messages))
        steps, self.now_ns = (self.end_ns - self.now_ns) // self.step_ns, self.end_ns
        bodies = {name: SimpleNamespace(work=self.read(f"{name}.work"), position=self.read(f"{name}.position", 3))
                  for name in self.bodies}  # fmt: skip
        forces = {name: np.concatenate([self.read(f"{name}.{what}", 3) for what in ("force", "torque")]) for name in self.bodies}
        impulses = {name: np.tile(force * (self.step_ns * 1e-9), (steps, 1)) for name, force in forces.items()}
        not_converged = self.read("solver.steps_not_converged")
        return UnitResult("warn" if not_converged else "ok", self.now_ns, steps, bodies,
                          SimpleNamespace(steps_not_converged=not_converged), SimpleNamespace(impulses=impulses))  # fmt: skip

    def zones(self):
        names = [name for name in self.variables if name.endswith(".compactness")]
        values = {name.removeprefix("zone.").removesuffix(".compactness").replace(".", "/"): self.read(name) for name in names}
        return {name: SimpleNamespace(compactness=None if np.isnan(value) else value) for name, value in values.items()}

    def read(self, name, count=None):
        """Returns the value of a scalar variable, or the array of the `count` elements of a vector."""
        names = [name] if count is None else [f"{name}[{k + 1}]" for k in range(count)]
        get = getattr(self.fmu, f"get{self.variables[names[0]].type}")
        values = get([self.variables[n].valueReference for n in names])
        return values[0] if count is None else np.array(values)

    def write(self, name, values):
        """Sets a scalar variable or the elements of a vector."""
        names = [name] if np.ndim(values) == 0 else [f"{name}[{k + 1}]" for k in range(len(values))]
        set_values = getattr(self.fmu, f"set{self.variables[names[0]].type}")
        set_values([self.variables[n].valueReference for n in names], np.atleast_1d(values).tolist())

    def _tine(self, name):
        """Returns the path of a tine from its name, `tine_1_plus`, and the case."""
        _, number, direction = name.split("_")
        values = self.case.to_dict()
        lift, insertion = values["tamping"]["lift"], values["tamping"]["insertion"]
        full_depth = values["bed"]["sleeper_underside_z_m"] + lift["height_m"] - insertion["depth_m"]
        return SimpleNamespace(name=name, pair=int(number) - 1, direction={"plus": 1.0, "minus": -1.0}[direction],
                               start=self.read(f"{name}.position", 3), full_depth_z=full_depth)  # fmt: skip


def _text(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def main():
    args = tamp.arguments()
    if Path(args.case).suffix != ".fmu":
        raise SystemExit(f"{args.case}: expected a co-simulation unit (.fmu); make one with `ballast export fmu`")
    for name in ("seed", "connect", "probe", "resume"):
        if getattr(args, name):
            raise SystemExit(f"--{name}: expected none with a co-simulation unit, found {getattr(args, name)!r}; leave it out")
    args.out.mkdir(parents=True, exist_ok=True)
    with UnitSimulation(args.case, args.threads) as sim:
        coupling, unit = tamp.couple_unit(sim, sim.case, args)
        run = tamp.new_run(sim, args)
        run["support"].append({})
        for k, window in enumerate(tamp.cycle_windows(coupling, unit, run, args), 1):
            if k % args.checkpoint == 0:
                print(f"{sim.now_ns * 1e-9:.3f} s  {unit.phase}  {window.iterations} iterations", flush=True)
        run["support"].append({})
        figures = tamp.summary(run, unit, sim)
    print("\n".join(tamp.write_figures(figures, args.out)))


if __name__ == "__main__":
    main()

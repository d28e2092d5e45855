"""Instance of a co-simulation unit of FMI 2.0 or 3.0 in FMPy, with variables by name."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import fmpy
from fmpy.simulation import instantiate_fmu


class Instance:
    """Instance of a unit, initialized with values of its variables unless a state of another instance follows."""

    def __init__(self, unit: Path, values: dict[str, Any] | None = None, *, state: bytes | None = None) -> None:
        description = fmpy.read_model_description(unit)
        self.variables = {variable.name: variable for variable in description.modelVariables}
        self.is_old = description.fmiVersion == "2.0"
        self.folder = TemporaryDirectory()
        fmpy.extract(unit, self.folder.name)
        self.fmu = instantiate_fmu(self.folder.name, description, "CoSimulation")
        if state is not None:
            self.fmu.setFMUState(self.fmu.deserializeFMUState(state))
            return
        self.set(values or {})
        if description.fmiVersion == "2.0":
            self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def __enter__(self) -> Instance:
        return self

    def __exit__(self, *error: object) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()
        self.folder.cleanup()

    def set(self, values: dict[str, Any]) -> None:
        for name, value in values.items():
            getattr(self.fmu, f"set{self._type(name)}")([self.variables[name].valueReference], [value])

    def get(self, name: str) -> Any:
        [value] = getattr(self.fmu, f"get{self._type(name)}")([self.variables[name].valueReference])
        return value.decode() if isinstance(value, bytes) else value

    def start(self, name: str) -> float:
        """Returns the start value of the description."""
        return float(self.variables[name].start)

    def state(self) -> bytes:
        return bytes(self.fmu.serializeFMUState(self.fmu.getFMUState()))

    def _type(self, name: str) -> str:
        kind = str(self.variables[name].type)
        return "Int64" if kind == "Enumeration" else kind

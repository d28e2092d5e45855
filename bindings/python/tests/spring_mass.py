"""Co-simulation unit of a mass on a spring (FMI 2.0), compiled from `data/spring_mass.c`."""

from __future__ import annotations

import subprocess
import zipfile
from pathlib import Path

SOURCE = Path(__file__).with_name("data") / "spring_mass.c"
#: Mass, kg; stiffness, N/m; damping, N s/m; velocity of the upper end of the spring, m/s.
PARAMETERS = {"MASS": 20.0, "STIFFNESS": 5e4, "DAMPING": 500.0, "SPEED": -0.3}
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="spring_mass" guid="{{spring_mass}}">
  <CoSimulation modelIdentifier="spring_mass" canHandleVariableCommunicationStepSize="true" canGetAndSetFMUstate="true"/>
  <DefaultExperiment startTime="0" stopTime="0.1" stepSize="{step}"/>
  <ModelVariables>
    <ScalarVariable name="force" valueReference="0" causality="input"><Real start="0"/></ScalarVariable>
    <ScalarVariable name="position" valueReference="1" causality="output" initial="exact"><Real start="{height}"/></ScalarVariable>
    <ScalarVariable name="velocity" valueReference="2" causality="output" initial="exact"><Real start="0"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure><Outputs><Unknown index="2"/><Unknown index="3"/></Outputs></ModelStructure>
</fmiModelDescription>
"""


def write_unit(path: Path, height: float, step: float) -> None:
    """Writes a unit whose mass starts at `height` (m); `step` (s) is the communication step that it recommends."""
    library = path.with_suffix(".so")
    values = PARAMETERS | {"HEIGHT": height}
    macros = [f"-D{name}=({value!r})" for name, value in values.items()]
    done = subprocess.run(["cc", "-O2", "-shared", "-fPIC", *macros, "-o", library, SOURCE], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION.format(height=repr(height), step=step))
        archive.write(library, "binaries/linux64/spring_mass.so")

"""Advances a unit with FMPy: python fmu_process.py UNIT FROM TO [STATE]; prints the hash of its state."""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave

STEP = 0.004


def advance(unit: Path, first: int, last: int, state: bytes | None = None) -> tuple[str, bytes]:
    """Lowers the first tine in the steps `first` to `last`; returns the hash of the state, and the state."""
    description = fmpy.read_model_description(unit)
    references = {v.name: v.valueReference for v in description.modelVariables}
    tine = next(name.split(".")[0] for name in references if name.startswith("tine"))
    with TemporaryDirectory() as folder:
        fmpy.extract(unit, folder)
        is_old = description.fmiVersion == "2.0"
        instance = (FMU2Slave if is_old else FMU3Slave)(
            guid=description.guid if is_old else description.instantiationToken,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="unit",
        )
        instance.instantiate()
        read = instance.getReal if is_old else instance.getFloat64
        write = instance.setReal if is_old else instance.setFloat64
        if state is not None:
            saved = (instance.deSerializeFMUstate if is_old else instance.deserializeFMUState)(state)
            (instance.setFMUstate if is_old else instance.setFMUState)(saved)
        else:
            if is_old:
                instance.setupExperiment(startTime=0.0)
            instance.enterInitializationMode()
            instance.exitInitializationMode()
        height, velocity = references[f"{tine}.position[3]"], references[f"{tine}.velocity[3]"]
        # The height at the start of the run is in the description.
        start = float(next(v.start for v in description.modelVariables if v.name == f"{tine}.position[3]"))
        for step in range(first, last):
            write([height, velocity], [start - 0.2 * STEP * (step + 1), -0.2])
            instance.doStep(step * STEP, STEP)
        assert read([height])[0] == start - 0.2 * STEP * last
        saved = (instance.getFMUstate if is_old else instance.getFMUState)()
        end = bytes((instance.serializeFMUstate if is_old else instance.serializeFMUState)(saved))
        [text] = instance.getString([references["state_hash"]])
        instance.terminate()
        instance.freeInstance()
    return (text.decode() if isinstance(text, bytes) else text), end


if __name__ == "__main__":
    unit, first, last, *state = sys.argv[1:]
    given = Path(state[0]).read_bytes() if state else None
    print(advance(Path(unit), int(first), int(last), given)[0])

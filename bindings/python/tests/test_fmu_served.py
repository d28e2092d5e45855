"""Co-simulation units whose bed is on a server, in FMPy: python test_fmu_served.py UNIT loads and unloads one ten times."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from conftest import ROOT
from test_remote import KEY, PROGRAM, Served

pytest.importorskip("fmpy")

import fmpy
from fmpy.fmi1 import FMICallException
from fmpy.simulation import instantiate_fmu
from fmpy.validation import validate_fmu
from fmu_instance import Instance

CASE = ROOT / "interfaces/cli/tests/data/tiny.toml"
TINE = "tine_1_plus"
STEP = 0.004
VERSIONS = [2, 3]


@pytest.fixture(scope="module")
def server(beds: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    served = Served(beds, tmp_path_factory.mktemp("server") / "serve")
    yield served
    served.end()


@pytest.fixture(scope="module")
def served_units(beds: Path, server: Served, tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    folder = tmp_path_factory.mktemp("served_units")
    export = [PROGRAM, "export", "fmu", CASE, "--out", folder / "tiny.fmu", "--fmi", "both", "--bed-cache", beds]
    served = ["--served", KEY, "--connect", server.endpoint]
    done = subprocess.run([*export, *served], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return {version: folder / f"tiny_fmi{version}.fmu" for version in VERSIONS}


def lower_tine(instance: Instance, step: int) -> str:
    """Lowers a tine in a step and returns the hash of the state."""
    height = f"{TINE}.position[3]"
    instance.set({height: instance.start(height) - 0.2 * STEP * (step + 1), f"{TINE}.velocity[3]": -0.2})
    instance.fmu.doStep(step * STEP, STEP)
    return instance.get("state_hash")


@pytest.mark.parametrize("version", VERSIONS)
def test_units_with_and_without_a_server_can_be_swapped(
    units: dict[int, Path], served_units: dict[int, Path], version: int
) -> None:
    assert validate_fmu(served_units[version]) == []
    local, served = (fmpy.read_model_description(all_units[version]) for all_units in (units, served_units))
    tables = [
        [(v.name, v.valueReference, v.type, v.causality, v.start, v.unit) for v in description.modelVariables]
        for description in (local, served)
    ]
    assert tables[0] == tables[1]
    abilities = served.coSimulation
    assert abilities.needsExecutionTool and not local.coSimulation.needsExecutionTool
    assert abilities.canGetAndSetFMUstate and not abilities.canSerializeFMUstate
    hashes = []
    for all_units in (units, served_units):
        with Instance(all_units[version]) as instance:
            hashes.append([lower_tine(instance, step) for step in range(4)])
    assert hashes[0] == hashes[1]


def test_units_can_be_loaded_and_unloaded(units: dict[int, Path], served_units: dict[int, Path]) -> None:
    for unit, is_local in ((units[3], True), (served_units[3], False)):
        done = subprocess.run([sys.executable, __file__, unit], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        *hashes, threads = done.stdout.split()
        assert len(hashes) == 10 and len(set(hashes)) == 1
        # Only Zenoh leaves threads, for which it pins the library.
        assert (int(threads) == 0) == is_local


def test_a_server_killed_in_a_step_leaves_a_status_and_the_step_is_repeated(
    units: dict[int, Path],
    served_units: dict[int, Path],
    beds: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    length = 1.0
    served = Served(beds, tmp_path / "serve")
    monkeypatch.setenv("BALLAST_FMU_CONNECT", served.endpoint)
    try:
        with Instance(served_units[2]) as instance, ThreadPoolExecutor() as threads:
            before = lower_tine(instance, 0)
            step = threads.submit(instance.fmu.doStep, STEP, length)
            time.sleep(0.05)
            served.process.send_signal(signal.SIGSTOP)
            assert not step.done(), "the step must last longer"
            served.end()
            with pytest.raises(FMICallException) as failure:
                step.result(timeout=60)
            assert failure.value.status == 2
            assert f"{KEY} is disconnected" in capsys.readouterr().out
            assert instance.get("state_hash") == before
            # Another step would leave open what the server has computed.
            with pytest.raises(FMICallException):
                instance.fmu.doStep(STEP, STEP)
            served.start("--resume")
            instance.fmu.doStep(STEP, length)
            after = instance.get("state_hash")
        with Instance(units[2]) as instance:
            lower_tine(instance, 0)
            instance.fmu.doStep(STEP, length)
            assert instance.get("state_hash") == after
    finally:
        served.end()


def load_and_unload(unit: Path, times: int) -> None:
    """Creates an instance, advances and frees it with its library again and again; prints hashes and threads left."""
    threads = Path("/proc/self/task")
    before = len(list(threads.iterdir()))
    description = fmpy.read_model_description(unit)
    reference = next(v.valueReference for v in description.modelVariables if v.name == "state_hash")
    with TemporaryDirectory() as folder:
        fmpy.extract(unit, folder)
        for _ in range(times):
            fmu = instantiate_fmu(folder, description, "CoSimulation")
            if description.fmiVersion == "2.0":
                fmu.setupExperiment(startTime=0.0)
            fmu.enterInitializationMode()
            fmu.exitInitializationMode()
            fmu.doStep(0.0, STEP)
            [text] = fmu.getString([reference])
            print(text.decode() if isinstance(text, bytes) else text)
            fmu.terminate()
            fmu.freeInstance()
    # Threads that end, and those of the server connection, may still run code of the library.
    time.sleep(0.5)
    print(len(list(threads.iterdir())) - before)


if __name__ == "__main__":
    load_and_unload(Path(sys.argv[1]), 10)

"""The wheel of `make wheel` in a fresh environment, where no compiler, no cargo and no HDF5 can be found.

Needs pytest only: `pytest --noconftest bindings/python/tests/test_wheel.py`.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
CASE = ROOT / "interfaces/cli/tests/data/tiny.toml"
WHEELS = sorted((ROOT / "target/wheel").glob("*.whl"))
# A program built with the HDF5 of the system, if there is one.
ORDINARY_PROGRAM = ROOT / "target/release/ballast"

pytestmark = pytest.mark.skipif(not WHEELS, reason="expected a wheel in target/wheel, found none; run `make wheel`")

#: Libraries of the C compiler and the C library.
SYSTEM = {
    "linux-vdso.so.1", "ld-linux-x86-64.so.2", "libc.so.6", "libm.so.6", "libgcc_s.so.1", "libpthread.so.0",
    "libdl.so.2",
}  # fmt: skip
#: Tools whose absence the tests check.
TOOLS = ["cargo", "rustc", "cc", "gcc", "c++", "clang", "ld", "make", "cmake", "pkg-config", "h5dump"]
#: Variables that could lead to them, or to another installation.
HIDDEN = re.compile("CARGO|RUST|HDF5|PKG_CONFIG|PYTHON|VIRTUAL_ENV|LD_|CC$|CFLAGS|LDFLAGS|BALLAST")


class Installation:
    """A virtual environment with the wheel and FMPy, and a working folder with a case and its bed."""

    def __init__(self, place: Path) -> None:
        self.venv, self.work = place / "venv", place / "work"
        subprocess.run([sys.executable, "-m", "venv", self.venv], check=True)
        self.work.mkdir()
        shutil.copy(CASE, self.work)
        self.environment = {name: value for name, value in os.environ.items() if not HIDDEN.match(name)}
        self.environment["PATH"] = str(self.venv / "bin")
        assert [tool for tool in TOOLS if shutil.which(tool, path=self.environment["PATH"])] == []
        pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary", ":all:"]
        self.call("python", *pip, WHEELS[-1], "fmpy>=0.3.32")
        self.call("ballast", "prepare", CASE.name)

    @property
    def binaries(self) -> list[Path]:
        """The extension module, the program and the library of units."""
        [extension] = self.venv.glob("lib/python3*/site-packages/ballast/_ballast.abi3.so")
        return [extension, self.venv / "bin/ballast", self.venv / "lib/ballast/libballast_fmu.so"]

    def start(self, program: str, *arguments: str | Path) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [self.venv / "bin" / program, *arguments], env=self.environment, cwd=self.work, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    def call(self, program: str, *arguments: str | Path, code: int = 0) -> str:
        """Returns the standard output of a program of the environment."""
        process = self.start(program, *arguments)
        out, errors = process.communicate(timeout=600)
        assert process.returncode == code, errors + out
        return out

    def python(self, *lines: str) -> str:
        return self.call("python", "-c", "\n".join(lines)).strip()

    def hash_of(self, run: str) -> str:
        """Returns the hash of the last state of a run."""
        return str(json.loads((self.work / run / "summary.json").read_text())["state_hash"])


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    return Installation(tmp_path_factory.mktemp("wheel"))


def libraries(listing: str) -> Sequence[str]:
    """Returns the names of libraries in the output of ldd."""
    return [Path(line.split()[0]).name for line in listing.splitlines()]


def test_only_the_c_library_is_linked(wheel: Installation) -> None:
    for binary in wheel.binaries:
        done = subprocess.run(["ldd", binary], capture_output=True, text=True, check=True)
        names = libraries(done.stdout)
        assert "libc.so.6" in names and set(names) <= SYSTEM, f"{binary.name}: {done.stdout}"


def test_no_binary_has_debug_information(wheel: Installation) -> None:
    assert [path.name for path in wheel.binaries if b".debug_info\0" in path.read_bytes()] == []


def test_the_tag_names_the_oldest_c_library(wheel: Installation) -> None:
    tag = re.search(r"manylinux_2_(\d+)_", WHEELS[-1].name)
    assert tag
    for binary in wheel.binaries:
        versions = [int(minor) for minor in re.findall(rb"\0GLIBC_2\.(\d+)", binary.read_bytes())]
        assert versions and max(versions) <= int(tag[1]), f"{binary.name}: GLIBC_2.{max(versions)}"


def test_the_package_steps_without_other_libraries(wheel: Installation) -> None:
    mapped = wheel.python(
        "import ballast, pathlib",
        "with ballast.open('tiny.toml', progress=False) as sim:",
        "    assert sim.advance_to(3 * sim.step_ns).status == 'ok'",
        "    sim.save().write('saved.h5')",
        "    assert ballast.read('saved.h5').hash == sim.save().hash",
        "print(*{line.split()[-1] for line in pathlib.Path('/proc/self/maps').open()})",
    )
    assert "_ballast.abi3.so" in mapped and "hdf5" not in mapped


def test_program_and_package_read_the_same_files(wheel: Installation) -> None:
    wheel.call("ballast", "run", "tiny.toml", "--steps", "5", "--out", "run")
    assert wheel.python(
        "import ballast",
        "assert len(ballast.read('run').times) > 0",
        "with ballast.resume('run', threads=1) as sim: print(sim.save().hash)",
    ) == wheel.hash_of("run")


@pytest.mark.skipif(not ORDINARY_PROGRAM.exists(), reason="the program is not built")
def test_states_and_files_are_those_of_an_ordinary_build(wheel: Installation) -> None:
    wheel.call("ballast", "run", "tiny.toml", "--steps", "40", "--out", "whole")
    wheel.call("ballast", "run", "tiny.toml", "--steps", "20", "--out", "half")
    for command in (["run", "tiny.toml", "--out", "ordinary"], ["resume", "half/checkpoint.h5"]):
        subprocess.run([ORDINARY_PROGRAM, *command, "--steps", "40"], cwd=wheel.work, check=True, capture_output=True)
    assert wheel.hash_of("whole") == wheel.hash_of("ordinary") == wheel.hash_of("half")
    wheel.call("ballast", "inspect", "ordinary/results.vtkhdf")


@pytest.mark.parametrize("demand", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_run_at_a_checkpoint(wheel: Installation, demand: signal.Signals) -> None:
    slow = CASE.read_text().replace("max_iterations = 30\ntolerance = 1e-3", "max_iterations = 1000\ntolerance = 0")
    (wheel.work / "slow.toml").write_text(slow)
    out = wheel.work / demand.name
    process = wheel.start("ballast", "run", "slow.toml", "--out", out)
    while process.poll() is None and not (out / "results.vtkhdf").exists():
        time.sleep(0.01)
    process.send_signal(demand)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 130 and "stopping" in errors, errors
    assert (out / "checkpoint.h5").exists()


def free_endpoint() -> str:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{one.getsockname()[1]}"


def test_the_doctor_finds_nothing(wheel: Installation) -> None:
    assert "FAILED" not in wheel.call("ballast", "doctor", "--listen", free_endpoint())


def test_the_package_drives_a_served_component(wheel: Installation) -> None:
    endpoint = free_endpoint()
    server = wheel.start("ballast", "serve", "tiny.toml", "--key", "test/bed", "--listen", endpoint, "--json")
    try:
        assert server.stdout
        assert any(json.loads(line)["event"] == "ready" for line in server.stdout)
        remote, local = (
            wheel.python(
                "import ballast",
                f"with ballast.open({address}) as sim:",
                "    sim.advance_to(5 * sim.step_ns)",
                "    print(sim.save().hash)",
            )
            for address in (f"'zenoh:test/bed', connect='{endpoint}'", "'tiny.toml', progress=False")
        )
        assert remote == local
    finally:
        server.terminate()
        server.communicate(timeout=60)


def test_units_are_exported_and_simulated(wheel: Installation) -> None:
    wheel.call("ballast", "export", "fmu", "tiny.toml", "--out", "tiny.fmu", "--fmi", "both")
    for unit in ("tiny_fmi2.fmu", "tiny_fmi3.fmu"):
        printed = wheel.python(
            "import fmpy",
            "from fmpy.validation import validate_fmu",
            f"assert validate_fmu('{unit}') == []",
            f"result = fmpy.simulate_fmu('{unit}', stop_time=0.02, output_interval=0.002)",
            "print(len(result), result.dtype.names)",
        )
        assert printed.startswith("11 ") and "sleeper_1.force" in printed

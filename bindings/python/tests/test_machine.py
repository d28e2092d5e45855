"""The tamping unit of examples/machine, alone and in the loop with a small bed."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ballast
import numpy as np
import pytest
from conftest import ROOT
from test_remote import KEY, Served

pytest.importorskip("scipy")
pytest.importorskip("matplotlib")
FOLDER = ROOT / "examples/machine"
sys.path.insert(0, str(FOLDER))
import machine  # noqa: E402

STEP = 8e-4


def unit(pairs_by_cycle: Any = None, **parameters: float) -> machine.TampingUnit:
    """A unit with two pairs of tines."""
    tines = [
        SimpleNamespace(name=f"{pair}{sign}", direction=sign, pair=pair, full_depth_z=0.2,
                        start=np.array([0.5 - 0.2 * sign, 0.1 + 0.1 * pair, 0.4]))
        for pair in (0, 1) for sign in (1.0, -1.0)
    ]  # fmt: skip
    station = machine.Station(tines, "sleeper", (0.5, 0.1, 0.2))
    return machine.TampingUnit([station], STEP, machine.Parameters(**parameters), pairs_by_cycle)


def run(made: machine.TampingUnit, stiffness: dict[int, float], onset: float = 0.01) -> list[str]:
    """Runs a cycle against springs that resist the closing of each pair; returns the phases."""
    forces = {name: np.zeros((2, 6)) for name in [*made.names, "sleeper"]}
    phases, t = [made.phase], 0.0
    while made.phase != "done":
        for name, sign, pair, closing in zip(made.names, made.signs, made.pair_list, made.closing(), strict=True):
            forces[name][:, 0] = -sign * stiffness[pair] * max(0.0, closing - onset)
            forces[name][:, 2] = 500.0 if made.phase == "squeeze" else 0.0
        made.advance(t, t + 2 * STEP, forces)
        t += 2 * STEP
        assert t < 3.0, f"the cycle stays in {made.phase}"
        if made.phase != phases[-1]:
            phases.append(made.phase)
    return phases


@pytest.fixture(scope="module")
def ended() -> machine.TampingUnit:
    """A unit after a cycle on stiff and soft ballast."""
    made = unit()
    assert run(made, {0: 8e5, 1: 3e5}) == ["lift", "insertion", "squeeze", "hold", "withdrawal", "done"]
    return made


def test_pairs_on_stiff_and_soft_ballast_stop_at_one_pressure(ended: machine.TampingUnit) -> None:
    made = ended
    stops = {stop["pair"]: stop for stop in made.logic["squeezes"]}
    assert {stop["cause"] for stop in stops.values()} == {"pressure"}
    assert stops[1]["closing"] > 1.3 * stops[0]["closing"]
    for stop in stops.values():
        assert stop["pressure"] == pytest.approx(made.p.preset_pressure, rel=0.02)


def test_pairs_without_resistance_stop_by_stroke_or_time() -> None:
    made = unit()
    run(made, {0: 0.0, 1: 0.0})
    assert [stop["cause"] for stop in made.logic["squeezes"]] == ["stroke", "stroke"]
    made = unit(squeeze_time=0.1)
    run(made, {0: 0.0, 1: 4e5})
    assert {stop["cause"] for stop in made.logic["squeezes"]} == {"time"}


def test_only_the_pairs_of_a_cycle_squeeze() -> None:
    made = unit([[1], [0, 1]])
    assert run(made, {0: 4e5, 1: 4e5}).count("insertion") == 2
    assert [(stop["cycle"], stop["pair"]) for stop in made.logic["squeezes"]][0] == (1, 1)
    assert sorted((stop["cycle"], stop["pair"]) for stop in made.logic["squeezes"]) == [(1, 1), (2, 0), (2, 1)]


def test_a_unit_walks_from_sleeper_to_sleeper() -> None:
    first = unit().stations[0]
    tines = [SimpleNamespace(name=f"next {t.name}", direction=t.direction, pair=t.pair + 2, full_depth_z=0.2,
                             start=t.start + [0.6, 0.0, 0.0]) for t in first.tines]  # fmt: skip
    made = machine.TampingUnit([first, machine.Station(tines, "next", (1.1, 0.1, 0.2))], STEP)
    forces = {name: np.zeros((2, 6)) for name in [*made.names, "sleeper", "next"]}
    phases, t = [made.phase], 0.0
    while made.phase != "done":
        before = made.motion()
        after = made.advance(t, t + 2 * STEP, forces)
        t += 2 * STEP
        if made.phase != phases[-1]:
            phases.append(made.phase)
        away = [tine.name for tine in made.stations[1 - made.station].tines]
        assert min(before[name][2] for name in away) > 0.38, "tines away from the unit stay up"
        # Where the unit changes places, no blade jumps.
        assert max(np.abs(after[name][:3] - before[name][:3]).max() for name in after) < 0.005
    cycle = ["lift", "insertion", "squeeze", "hold", "withdrawal"]
    assert phases == [*cycle, "travel", *cycle, "done"]
    assert [s["sleeper"] for s in made.logic["squeezes"]] == 2 * ["sleeper"] + 2 * ["next"]
    assert [s["pair"] for s in made.logic["squeezes"]] == [0, 1, 2, 3]
    assert after["sleeper"][2] == after["next"][2] == pytest.approx(0.22)


def test_energy_of_the_unit_is_conserved(ended: machine.TampingUnit) -> None:
    e = ended.energies()
    drives = e["pump"] + e["eccentric motor"]
    assert drives > 5000.0 and abs(e["tines"]) > 100.0
    lost = e["valves"] + e["friction"] + e["leakage and relief"]
    assert drives == pytest.approx(e["stored"] + lost + e["tines"], abs=1e-4 * drives)


def test_the_model_gives_the_reference_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures of a cycle on springs, which the unit in Rust must also give; BALLAST_WRITE_DOCS writes them."""
    made, rows = unit(), []
    advance = made.advance

    def recorded(*arguments: Any) -> Any:
        motion = advance(*arguments)
        rows.append(made.trace[-1])
        return motion

    monkeypatch.setattr(made, "advance", recorded)
    run(made, {0: 8e5, 1: 3e5})
    # Closings, load pressures of pairs, depth and supply pressure.
    arms, pairs = len(made.names), len(made.arms_of)
    first_pair = len(machine.TRACE) + len(machine.ARM_TRACE) * arms
    columns: dict[str, Any] = {
        "depth": lambda row: [row[1]], "supply": lambda row: [row[3]],
        "closing": lambda row: row[len(machine.TRACE) :][:arms], "load_pressure": lambda row: row[first_pair:][:pairs],
    }  # fmt: skip
    found = {
        "parameters": asdict(made.p), "stiffness": [8e5, 3e5], "onset": 0.01, "step": STEP,
        "instants": [
            {"time": float(row[0])} | {name: [float(f"{v:.6g}") for v in of(row)] for name, of in columns.items()}
            for row in rows[59::60]
        ],
        "squeezes": made.logic["squeezes"], "energies": made.energies(),
    }  # fmt: skip
    path = FOLDER / "reference.json"
    if os.environ.get("BALLAST_WRITE_DOCS"):
        path.write_text(json.dumps(found, indent=1) + "\n")
    expected = json.loads(path.read_text())
    assert found["parameters"] == expected["parameters"]
    assert [s["cause"] for s in found["squeezes"]] == [s["cause"] for s in expected["squeezes"]]
    assert found["energies"] == pytest.approx(expected["energies"], rel=1e-3)
    for name in columns:
        values, reference = (np.array([i[name] for i in f["instants"]]) for f in (found, expected))
        assert values == pytest.approx(reference, abs=1e-3 * np.abs(reference).max()), name


def test_blades_move_on_arcs_and_vibrate_in_opposition() -> None:
    made = unit()
    made.y[made.at["phi"]] = 0.1
    rows, length = made.motion(), made.p.lower_length
    for tine, sign in zip(made.stations[0].tines, made.signs, strict=True):
        name, start = tine.name, tine.start
        assert rows[name][:3] - start == pytest.approx([sign * length * np.sin(0.1), 0.0, length * (1 - np.cos(0.1))])
        assert rows[name][4] == -sign * 0.1
    made = unit()
    made.y[made.at["omega"]], made.y[made.at["vz"]] = 200.0, -0.3
    made.y[made.at["dphi"]] = 0.5
    # The motion is the derivative of the position.
    made.logic["phase"] = "hold"
    before = made.motion()
    after = made.advance(0.0, 1e-6, {name: np.zeros((1, 6)) for name in [*made.names, "sleeper"]})
    for name in made.names:
        assert (after[name][:6] - before[name][:6]) / 1e-6 == pytest.approx(before[name][6:], abs=2e-3)


@pytest.fixture(scope="module")
def place(machine_case: ballast.Case, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Working folder with the case for a partner with mass."""
    folder = tmp_path_factory.mktemp("machine")
    machine_case.write(folder / "small.toml")
    return folder


PROGRAM = [sys.executable, str(FOLDER / "tamp.py"), "small.toml", "--threads", "1",
           "--set", "preset_pressure=2e6", "--set", "insertion_limit=0.12", "--checkpoint", "20", "--probe", "50"]  # fmt: skip


@pytest.fixture(scope="module")
def undisturbed(place: Path) -> dict[str, Any]:
    done = subprocess.run([*PROGRAM, "--out", "whole"], capture_output=True, text=True, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    figures: dict[str, Any] = json.loads((place / "whole/figures.json").read_text())
    return figures


def test_coupled_cycle(place: Path, undisturbed: dict[str, Any]) -> None:
    f = undisturbed
    assert f["phase"] == "done" and f["not_converged"] == 0 and f["iterations"]["median"] <= 4
    assert f["iterations"]["max"] > 1 and f["received"] > 5.0
    assert abs(f["balance_error"]) < 0.01 * f["drives"]
    assert f["given"] == pytest.approx(f["received"], rel=0.01)
    [squeeze] = f["squeezes"].values()
    assert squeeze["cause"] in machine.STOP_CAUSES and squeeze["work"] > 0.0
    assert len(f["compactness"]) == 2 and f["compactness"][0].keys() == f["compactness"][1].keys()
    assert [list(s) for s in f["support"]] == 2 * [["sleeper_1"]] and f["support"][1]["sleeper_1"]["unloading"] > 0.0
    rows = (place / "whole/table.md").read_text()
    assert "stop by" in rows and "compactness of under/sleeper_1" in rows
    assert (place / "whole/machine.png").stat().st_size > 20000
    assert "stop by" in (place / "whole/report.html").read_text()


def kill_in_the_squeeze(program: list[str], place: Path) -> None:
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True, cwd=place) as killed:
        assert killed.stdout is not None
        assert any("squeeze" in line for line in killed.stdout), "no checkpoint in the squeeze"
        killed.send_signal(signal.SIGKILL)


def test_a_partner_killed_in_the_squeeze_continues_with_the_same_bytes(place: Path, undisturbed: dict[str, Any]) -> None:
    program = [*PROGRAM, "--out", "killed"]
    kill_in_the_squeeze(program, place)
    assert not (place / "killed/figures.json").exists()
    other = subprocess.run([*program, "--resume", "--window", "4"], capture_output=True, text=True, cwd=place)
    assert other.returncode == 1 and "--window: expected 2 as before, found 4" in other.stderr
    done = subprocess.run([*program, "--resume"], capture_output=True, text=True, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    continued = json.loads((place / "killed/figures.json").read_text())
    assert {k: v for k, v in continued.items() if k != "wall"} == {k: v for k, v in undisturbed.items() if k != "wall"}


def test_the_same_loop_over_the_network_with_a_killed_partner(place: Path, beds: Path, undisturbed: dict[str, Any]) -> None:
    served = Served(beds, place / "serve", place / "small.toml")
    try:
        program = [*PROGRAM, "--out", "there", "--connect", f"zenoh:{KEY}", "--endpoint", served.endpoint]
        kill_in_the_squeeze(program, place)
        done = subprocess.run([*program, "--resume"], capture_output=True, text=True, cwd=place)
    finally:
        served.end()
    assert done.returncode == 0, done.stdout + done.stderr
    there = json.loads((place / "there/figures.json").read_text())
    for name in ("hash", "squeezes", "energies", "windows", "iterations", "peak_force"):
        assert there[name] == undisturbed[name], name


def test_imposed_motion_is_compared_with_the_loop(place: Path) -> None:
    short = {"preset_pressure": 2e6, "lift_time": 0.02, "insertion_time": 0.05, "insertion_limit": 0.06, "squeeze_time": 0.08,
             "withdrawal_time": 0.05}  # fmt: skip
    settings = [text for name, value in short.items() for text in ("--set", f"{name}={value}")]
    program = [sys.executable, FOLDER / "study.py", "small.toml", "--seeds", "3", "--jobs", "1", "--out", "study", *settings]
    done = subprocess.run(program, capture_output=True, text=True, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    [row] = csv.DictReader((place / "study/figures.csv").open())
    assert float(row["same closing: mean closing, mm"]) == pytest.approx(float(row["loop: mean closing, mm"]), rel=0.02)
    assert float(row["imposed: work on the ballast, J"]) > float(row["loop: work on the ballast, J"]) > 0.0
    assert "imposed less loop" in (place / "study/study.md").read_text()
    refused = subprocess.run([*program, "--kinds", "imposed"], capture_output=True, text=True, cwd=place)
    assert refused.returncode == 1 and "--kinds: expected loop" in refused.stderr


def test_schemes_are_compared(place: Path) -> None:
    done = subprocess.run([*PROGRAM, "--out", "part", "--windows", "120"], capture_output=True, text=True, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    program = [sys.executable, FOLDER / "schemes.py", "part", "--case", "small.toml", "--steps", "8", "--common", "2"]
    done = subprocess.run(program, capture_output=True, text=True, cwd=place)
    assert done.returncode == 0, done.stdout + done.stderr
    rows = [line.split(" | ") for line in (place / "part/schemes.md").read_text().splitlines()[2:]]
    errors = {(row[0].strip("| "), int(row[1])): float(row[2]) for row in rows}
    assert len(errors) == 5 * 2
    assert errors["implicit iqn-ils", 1] < 0.1 * errors["parallel", 2]
    assert (place / "part/schemes.png").stat().st_size > 10000

"""The track of examples/track, alone and on a small bed."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import ballast
import numpy as np
import pytest
from conftest import ROOT

pytest.importorskip("matplotlib")
FOLDER = ROOT / "examples/track"
sys.path.insert(0, str(FOLDER))
import track  # noqa: E402


def run(model: track.Track, end: float, pulls: bool = True) -> dict[str, Any]:
    """Runs a track to a time on springs and dampers as below its outer sleepers; returns its trace by name."""
    p, h, t = model.p, 8e-4, 0.0
    forces = {name: np.zeros((1, 6)) for name in model.names}
    rows = []
    while t < end:
        for k, name in enumerate(model.names):
            z, speed = (part[model.first_sleeper + 2 * k] for part in (model.q, model.v))
            is_pressed = pulls or z < 0.0
            forces[name][:, 2] = -p.share * is_pressed * (p.outer_stiffness * z + p.outer_damping * speed)
        model.advance(t, t + h, forces)
        rows.append(model.trace[-1])
        t += h
    n, trace = len(model.names), np.array(rows)
    return {"time": trace[:, 0], "place": trace[:, 1], "load": trace[:, 2], "height": trace[:, 3 : 3 + n], "force": trace[:, 3 + n :]}


SLEEPERS = {f"s{k}": np.array([0.6 * k, 0.0, 0.0]) for k in range(3)}


def test_static_deflection_is_that_of_a_beam_on_an_elastic_foundation() -> None:
    p = track.Parameters(speed=4.0, seating_time=0.4, ramp_time=0.3)
    model = track.Track(SLEEPERS, 0.0, 1, p)
    found = run(model, model.duration())
    rest = found["height"][np.searchsorted(found["time"], 0.4) - 2, 1]
    over = np.argmin(np.abs(found["place"] - 0.6) + (found["load"] < found["load"].max()))
    support = 1 / (1 / p.pad_stiffness + 1 / p.outer_stiffness)
    wave = (support / 0.6 / (4 * p.bending_stiffness)) ** 0.25
    rail = p.wheel_load * wave / (2 * support / 0.6)
    assert rest - found["height"][over, 1] == pytest.approx(rail * support / p.outer_stiffness, rel=0.03)


def test_a_high_sleeper_carries_the_track_that_it_lifts() -> None:
    p, height = track.Parameters(laying_time=0.2, seating_time=0.6), 0.01
    found = run(track.Track(SLEEPERS, 0.0, 1, p, [0.0, height, 0.0]), 0.6, pulls=False)
    # A beam under its weight, lifted from a rigid floor at one place.
    weight = track.GRAVITY * (p.rail_mass + p.sleeper_mass / 0.6)
    reach = (72 * p.bending_stiffness * height / weight) ** 0.25
    assert found["force"][-1, 1] == pytest.approx(p.share * 4 / 3 * weight * reach, rel=0.05)
    assert found["force"][-1, 0] == found["force"][-1, 2] == 0.0, "the neighbours hang"
    assert 0.8 * height < found["height"][-1, 0] < height


@pytest.mark.parametrize("heights", [None, [0.0, 0.005, 0.0]])
def test_energy_of_the_track_is_conserved(heights: list[float] | None) -> None:
    model = track.Track(SLEEPERS, 0.0, 2, track.Parameters(), heights)
    run(model, model.duration())
    e = model.energies()
    drives = e["gravity"] + e["wheel load"] + e["traction"] + e["laying"]
    assert drives > 5.0
    assert e["stored"] + e["dampers"] + e["ballast"] == pytest.approx(drives, rel=1e-3)


def test_passages_on_a_small_bed_undisturbed_and_killed(case: ballast.Case, tmp_path: Path) -> None:
    values = case.to_dict()
    values["bed"]["size_m"] = [0.45, 0.10, 0.25]
    values["bed"]["stiffness"] = {"grain_N_per_m": 1e6}
    values["sleepers"] |= {"count": 3, "pitch_m": 0.14, "tamped": [2]}
    values["tines"]["gap_to_sleeper_m"] = 0.02
    values["tines"]["mount"] = {"rigid": True}
    values["tamping"]["squeeze"]["stroke_m"] = 0.01
    values["tamping"]["insertion"]["duration_s"] = 0.1
    values["run"]["step_s"] = 5e-4
    values["solver"] |= {"max_iterations": 1000, "tolerance": 1e-4}
    ballast.Case.from_dict(values).write(tmp_path / "small.toml")
    # A light wheel on a soft and light rail, for a bed of small stones.
    soft = {"wheel_load": 500, "wheel_mass": 5, "rail_mass": 1, "sleeper_mass": 1, "sleeper_inertia": 0.001,
            "bending_stiffness": 1e3, "pad_stiffness": 1e6, "pad_damping": 200, "outer_stiffness": 2e5, "outer_damping": 200,
            "contact_stiffness": 1e6, "speed": 20, "share": 1, "laying_time": 0.01, "seating_time": 0.02, "rest_time": 0.01}  # fmt: skip
    settings = [text for name, value in soft.items() for text in ("--set", f"{name}={value}")]
    quick = {"lift_time": 0.03, "insertion_time": 0.05, "insertion_limit": 0.06, "squeeze_time": 0.05, "hold_time": 0.01,
             "withdrawal_time": 0.08}  # fmt: skip
    settings += [text for name, value in quick.items() for text in ("--unit", f"{name}={value}")]
    program = [sys.executable, FOLDER / "passage.py", "small.toml", "--axles", "1", "--consolidation", "200",
               "--seating", "20", "--threads", "1", *settings]  # fmt: skip
    done = subprocess.run([*program, "--out", "whole"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    whole = json.loads((tmp_path / "whole/figures.json").read_text())
    assert whole["tamping"]["windows"] > 40 and whole["tamping"]["not_converged"] == 0
    for figures in (whole["before"], whole["after"]):
        assert figures["not_converged"] == 0 and figures["windows"] > 40
        [axle] = figures["axles"]
        assert min(axle["deflection"]) > 0.0 and 0.02 < axle["load_share"] < 1.2
        assert figures["energy_lost"] < 0.02 * figures["work_exchanged"]
        assert abs(figures["balance_error"]) < 0.02 * figures["drives"]
    assert (tmp_path / "whole/track.png").stat().st_size > 20000
    assert "load share of the middle sleeper" in (tmp_path / "whole/table.md").read_text()

    program += ["--out", "killed", "--checkpoint", "10"]
    with subprocess.Popen(program, stdout=subprocess.PIPE, text=True, cwd=tmp_path) as killed:
        assert killed.stdout is not None
        assert any(line.startswith("after tamping") for line in killed.stdout), "no checkpoint in a passage"
        killed.send_signal(signal.SIGKILL)
    assert not (tmp_path / "killed/figures.json").exists()
    done = subprocess.run([*program, "--resume"], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    resumed = json.loads((tmp_path / "killed/figures.json").read_text())
    for figures in (whole, resumed):
        for when in ("before", "after"):
            del figures[when]["wall"]
    assert resumed == whole

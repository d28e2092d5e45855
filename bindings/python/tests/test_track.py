"""The track of examples/track, alone and on a small bed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import ballast
import numpy as np
import pytest
from conftest import ROOT

pytest.importorskip("matplotlib")
FOLDER = ROOT / "examples/track"
sys.path.insert(0, str(FOLDER))
import track  # noqa: E402


def test_static_deflection_is_that_of_a_beam_on_an_elastic_foundation() -> None:
    p = track.Parameters(speed=2.0, seating_time=0.5, ramp_time=0.3)
    sleepers = {f"s{k}": np.array([0.6 * k, 0.0, 0.0]) for k in range(3)}
    model, h = track.Track(sleepers, 0.0, 1, p), 1e-3
    forces = {name: np.zeros((1, 6)) for name in sleepers}
    rows = []
    t = 0.0
    while t < model.duration():
        # Springs as below the outer sleepers.
        for k, name in enumerate(sleepers):
            z, speed = (part[model.first_sleeper + 2 * k] for part in (model.q, model.v))
            forces[name][:, 2] = -p.share * (p.outer_stiffness * z + p.outer_damping * speed)
        model.advance(t, t + h, forces)
        rows.append(model.trace[-1])
        t += h
    time, place, load, *heights = np.array(rows)[:, :6].T
    rest = heights[1][np.searchsorted(time, 0.5) - 2]
    over = np.argmin(np.abs(place - 0.6) + (load < load.max()))
    support = 1 / (1 / p.pad_stiffness + 1 / p.outer_stiffness)
    wave = (support / 0.6 / (4 * p.bending_stiffness)) ** 0.25
    rail = p.wheel_load * wave / (2 * support / 0.6)
    assert rest - heights[1][over] == pytest.approx(rail * support / p.outer_stiffness, rel=0.03)


def test_passages_on_a_small_bed(case: ballast.Case, tmp_path: Path) -> None:
    values = case.to_dict()
    values["bed"]["size_m"] = [0.45, 0.10, 0.25]
    values["bed"]["stiffness"] = {"grain_N_per_m": 1e6}
    values["sleepers"] |= {"count": 3, "pitch_m": 0.14, "tamped": [2]}
    values["tines"]["gap_to_sleeper_m"] = 0.02
    values["tamping"]["squeeze"]["stroke_m"] = 0.01
    values["run"]["step_s"] = 5e-4
    values["solver"] |= {"max_iterations": 1000, "tolerance": 1e-4}
    ballast.Case.from_dict(values).write(tmp_path / "small.toml")
    # A light wheel on a soft rail, for a bed of small stones.
    soft = {"wheel_load": 500, "wheel_mass": 5, "rail_mass": 1, "sleeper_mass": 1, "sleeper_inertia": 0.001,
            "bending_stiffness": 1e3, "pad_stiffness": 1e6, "pad_damping": 200, "outer_stiffness": 2e5, "outer_damping": 200,
            "contact_stiffness": 1e6, "speed": 40, "share": 1, "seating_time": 0.01, "rest_time": 0.01}  # fmt: skip
    settings = [text for name, value in soft.items() for text in ("--set", f"{name}={value}")]
    program = [sys.executable, FOLDER / "passage.py", "small.toml", "--axles", "2", "--consolidation", "200",
               "--seating", "20", "--threads", "1", *settings]  # fmt: skip
    done = subprocess.run(program, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    for figures in json.loads((tmp_path / "runs/track/figures.json").read_text()).values():
        assert figures["not_converged"] == 0 and figures["windows"] > 40
        assert len(figures["axles"]) == 2 and min(figures["axles"][0]["deflection"]) > 0.0
        assert 0.02 < figures["axles"][1]["load_share"] < 1.0
        assert figures["energy_lost"] < 0.02 * figures["work_exchanged"]
    assert (tmp_path / "runs/track/track.png").stat().st_size > 20000
    assert "load share of the middle sleeper" in (tmp_path / "runs/track/table.md").read_text()

"""Plates from Python: moved by the case, and by a partner."""

from __future__ import annotations

from pathlib import Path

import ballast
import numpy as np
import pytest

PRESS = {
    "name": "press",
    "bed": {
        "size_m": [0.16, 0.12, 0.25],
        "sleeper_underside_z_m": 0.06,
        "grains": {"classes": [{"size_m": 0.03, "number_fraction": 1.0}], "shape_count": 6},
        "preparation": {"iterations": 20, "max_settling_s": 0.4},
    },
    "plate": [{
        "name": "piston", "x_m": 0.08, "y_m": 0.06, "boxes": [{"size_m": [0.16, 0.12, 0.02]}],
        "motion": [{"time_s": 0.01, "displacement_m": [0.0, 0.0, -0.002]}],
    }],
    "run": {"duration_s": 0.02, "step_s": 1e-3},
    "solver": {"max_iterations": 30},
}  # fmt: skip


def test_plates_follow_the_case_and_a_partner(tmp_path: Path) -> None:
    case = ballast.Case.from_dict(PRESS)
    with ballast.open(case, bed_cache=tmp_path, threads=1, progress=False) as sim:
        assert sim.roles["piston"] == "plate"
        start, q = sim.save().commanded_pose("piston")
        for _ in range(10):
            window = sim.step_tamping_cycle()
        below, _ = sim.save().commanded_pose("piston")
        assert below - start == pytest.approx([0.0, 0.0, -0.002], abs=1e-14)
        assert window["piston"].mean_force[2] > 0
        times = [sim.now_ns, sim.now_ns + 5 * sim.step_ns]
        motion = ballast.Motion(times, [below, below + np.array([0.0, 0.0, 0.003])], [q, q])
        sim.advance_to(times[1], {"piston": motion})
        above, _ = sim.save().commanded_pose("piston")
        assert above - below == pytest.approx([0.0, 0.0, 0.003], abs=1e-14)

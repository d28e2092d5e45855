"""Environment, studies, plots, pictures and files."""

from __future__ import annotations

import base64
import functools
import importlib
import io
import json
import math
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
import tomllib
import warnings
import zipfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace

import ballast
import numpy as np
import pytest
from ballast import _identity


def test_the_environment_passes_the_checks_of_gymnasium(case: ballast.Case, beds: Path) -> None:
    gymnasium = pytest.importorskip("gymnasium")
    from gymnasium.utils.env_checker import check_env

    from ballast.gym import TampingEnv

    env = TampingEnv(case, bed_cache=beds)
    assert isinstance(env, gymnasium.Env)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        check_env(env)


def test_seeds_reproduce_an_episode(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    def episode(threads: int) -> list[object]:
        env = TampingEnv(case, bed_cache=beds, threads=threads)
        observation, _ = env.reset(seed=3)
        env.action_space.seed(3)
        seen: list[object] = [observation.tolist()]
        ended = False
        while not ended:
            squeeze = np.array([1.0, env.action_space.sample()[1], 1.0])
            observation, reward, terminated, truncated, info = env.step(squeeze)
            assert "error_message" not in info, info
            seen += [observation.tolist(), reward]
            ended = terminated or truncated
        assert observation[0] > 0.5 and observation[1] > 0.5, "the tines went down and closed"
        with pytest.raises(ballast.Error, match="found one that has ended; reset first"):
            env.step(squeeze)
        env.reset()
        env.step(squeeze)
        return seen

    assert episode(1) == episode(2)


def test_invalid_actions_are_refused(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    env = TampingEnv(case, bed_cache=beds)
    with pytest.raises(ballast.Error, match="found none; reset first"):
        env.step(np.zeros(3))
    before, _ = env.reset(seed=1)
    for wrong in ([0.0, np.nan, 0.0], [np.inf, 0.0, 0.0], [0.0, 0.0]):
        with pytest.raises(ballast.Error, match="action: expected 3 numbers from -1 to 1, found"):
            env.step(np.array(wrong))
    for other in ("abc", {"speed": 1.0}, None):
        with pytest.raises(ballast.Error, match="action: expected 3 numbers from -1 to 1, found"):
            env.step(other)  # type: ignore[arg-type]
    assert np.isfinite(env.step(np.array([0.0, 2.0, 0.0]))[0]).all()


def test_cases_without_tines_or_tamped_ballast_are_refused(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from conftest import renamed

    from ballast.gym import TampingEnv

    values = case.to_dict()
    del values["tines"]
    without_tines = ballast.Case.from_dict(values)
    values = renamed(case).to_dict()
    values["sleeper"][0]["tamped"] = False
    untamped = ballast.Case.from_dict(values)
    for other, said in ((without_tines, "a case with tines"), (untamped, "a case with ballast under a tamped sleeper")):
        with pytest.raises(ballast.Error, match=re.escape(f'Case("tiny"): expected {said}, found none')):
            TampingEnv(other, bed_cache=beds)


class Stuck:
    """A simulation whose tamping cycle fails at the third step."""

    def __init__(self, sim: ballast.Simulation) -> None:
        self.sim, self.left = sim, 3

    def __enter__(self) -> Stuck:
        return self

    def __exit__(self, *error: object) -> None:
        self.sim.close()

    def __getattr__(self, name: str) -> object:
        return getattr(self.sim, name)

    def step_tamping_cycle(self) -> object:
        self.left -= 1
        assert self.left >= 0, "the same step is asked for again and again"
        return SimpleNamespace(status="discard" if self.left == 0 else "ok", error_message="a stone is too fast")


def test_failed_lifts_raise(
    case: ballast.Case, beds: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    begin = ballast.open
    monkeypatch.setattr(ballast, "open", lambda case, **options: Stuck(begin(case, **options)))
    with pytest.raises(ballast.Error, match="status='discard'.*: a stone is too fast"):
        TampingEnv(case, bed_cache=beds)


class Measured:
    """A simulation with fixed zones: one can be measured only before its window, another only after."""

    def __init__(self, sim: ballast.Simulation) -> None:
        self.sim = sim

    def __getattr__(self, name: str) -> object:
        return getattr(self.sim, name)

    def zones(self) -> dict[str, object]:
        return measured({"under/sleeper_1/1": 0.5, "under/sleeper_1/2": 0.25, "under/sleeper_1/3": None, "under/other": 0.9, "crib": 0.9})

    def advance_to(self, t1_ns: int, motions: dict[str, ballast.Motion], *, zones: bool) -> object:
        out = self.sim.advance_to(t1_ns, motions)
        return MeasuredResult(out)


class MeasuredResult:
    def __init__(self, out: ballast.WindowResult) -> None:
        self.out, self.status = out, out.status
        self.zones = measured({
            "under/sleeper_1/1": None, "under/sleeper_1/2": 0.35, "under/sleeper_1/3": 0.9, "under/other": 0.9, "crib": 0.9,
        })  # fmt: skip

    def __getitem__(self, name: str) -> ballast.BodyResult:
        return self.out[name]


def measured(values: dict[str, float | None]) -> dict[str, object]:
    return {name: SimpleNamespace(compactness=value) for name, value in values.items()}


def test_compactness_keeps_its_zones(
    case: ballast.Case, beds: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    env = TampingEnv(case, bed_cache=beds)
    begin = env._simulation_after_lift
    monkeypatch.setattr(env, "_simulation_after_lift", lambda bed: Measured(begin(bed)))
    before, _ = env.reset(seed=1)
    after, _, _, _, info = env.step(np.array([-1.0, 0.0, -1.0]))
    assert before[2] == pytest.approx(0.375) and after[2] == pytest.approx(0.425)
    assert info["gain_percent"] == pytest.approx(5.0)
    # What was known last goes with the episode.
    kept = pickle.loads(pickle.dumps(env.save()))
    assert kept.zones == {"under/sleeper_1/1": 0.5, "under/sleeper_1/2": 0.35} and kept.compactness == after[2]


def test_the_insertion_speed_limits_all_tines(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from conftest import renamed

    from ballast.gym import TampingEnv

    values = renamed(case).to_dict()
    # The upper edges of both end at the same depth, so the second one has farther to go.
    values["tine"][1]["blade_size_m"][2] += 0.01
    env = TampingEnv(ballast.Case.from_dict(values), bed_cache=beds, insertion_speed=0.6)
    env.reset(seed=1)
    assert env._sim is not None
    begun = env._sim.save()
    env.step(np.array([-1.0, 0.0, 1.0]))
    ended = env._sim.save()
    ways = [float(begun.commanded_pose(tine.name)[0][2] - ended.commanded_pose(tine.name)[0][2]) for tine in env._tines]
    assert max(ways) == pytest.approx(0.6 * 0.02) and min(ways) < 0.9 * max(ways)


def test_failed_steps_truncate_the_episode(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    env = TampingEnv(case, bed_cache=beds, interval_s=1e-3, squeeze_speed=1e5)
    before, _ = env.reset(seed=1)
    after, reward, terminated, truncated, info = env.step(np.array([1.0, 0.0, 0.0]))
    assert (reward, terminated, truncated) == (0.0, False, True) and after.tolist() == before.tolist()
    assert info.pop("error_message").startswith("step at t = ")
    assert info == {"gain_percent": 0.0, "work_J": 0.0, "code": "over_speed"}


def test_bed_seeds_are_whole_numbers(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    for seeds in (3, [1.5], ["1"]):
        with pytest.raises(TypeError, match=f"seeds: expected a list of whole numbers, found {re.escape(repr(seeds))}"):
            TampingEnv(case, seeds=seeds, bed_cache=beds)  # type: ignore[arg-type]


def test_observations_contain_the_vibration(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    env = TampingEnv(case, bed_cache=beds)
    before, _ = env.reset(seed=1)
    assert before[-3:].tolist() == [0.0, 1.0, 0.0]
    # 35 Hz from the start, then gliding to 50: the angle is that of 35 and of 42.5 Hz, for 0.02 s each.
    for action, frequency, turns in [(0.0, 35.0, 0.7), (1.0, 50.0, 1.55)]:
        seen, *_ = env.step(np.array([-1.0, action, -1.0]))
        angle = math.tau * turns
        assert seen[-3:] == pytest.approx([math.sin(angle), math.cos(angle), frequency / 50.0], abs=1e-9)


def test_episodes_start_at_the_commanded_pose(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    # The last step of this lift is the first of the insertion.
    half = 0.5e-9 * case.step_ns
    lift = case.to_dict()["tamping"]["lift"]["duration_s"]
    env = TampingEnv(case.with_values({"tamping.lift.duration_s": lift + half}), bed_cache=beds)
    env.reset(seed=1)
    _, _, _, truncated, info = env.step(np.array([0.0, 0.0, 1.0]))
    assert not truncated and "error_message" not in info


@pytest.mark.parametrize("interval_s", [0.07, 1.0, 1e6])
def test_episodes_end_with_the_run(case: ballast.Case, beds: Path, interval_s: float) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    env = TampingEnv(case, bed_cache=beds, interval_s=interval_s)
    env.reset(seed=1)
    times, is_over = [], False
    while not is_over:
        seen, _, closed, is_over, info = env.step(np.array([-1.0, 0.0, -1.0]))
        assert not closed and "error_message" not in info, info
        times.append(seen[3])
    assert times[-1] == 1.0 and times == sorted(set(times)) and len(times) == (3 if interval_s == 0.07 else 1)


def test_intervals_are_whole_time_steps(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    for interval_s, nearest in ((0.0205, "0.02 or 0.021"), (4e-4, "0.001"), (1e-10, "0.001"), (0.001000001, "0.001 or 0.002")):
        said = f"interval_s: expected a whole number of steps of 0.001 s, such as {nearest}, found {interval_s}"
        with pytest.raises(ValueError, match=re.escape(said)):
            TampingEnv(case, bed_cache=beds, interval_s=interval_s)


def test_episodes_can_be_saved_and_restored(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    def rest(env: TampingEnv) -> list[object]:
        seen: list[object] = []
        for speed in (1.0, 0.5):
            observation, *more = env.step(np.array([speed, -speed, 1.0]))
            seen += [observation.tolist(), *more]
        return seen

    env = TampingEnv(case, bed_cache=beds)
    with pytest.raises(ballast.Error, match="save: expected an episode, found none"):
        env.save()
    env.reset(seed=1)
    before, *_ = env.step(np.array([1.0, 0.0, 1.0]))
    kept = env.save()
    # Two that stand alike are two: they can be looked for, and kept in sets.
    again = env.restore(kept), env.save()
    assert again[0].tolist() == before.tolist() and kept == kept and again[1] != kept and len({kept, again[1]}) == 2
    reported = rest(env)
    assert env.restore(kept).tolist() == before.tolist() and rest(env) == reported
    other = TampingEnv(case, bed_cache=beds)
    assert other.restore(pickle.loads(pickle.dumps(kept))).tolist() == before.tolist() and rest(other) == reported
    slower = TampingEnv(case.with_values({"tamping.vibration.frequency_Hz": 20.0}), bed_cache=beds)
    with pytest.raises(ballast.Error, match="restore: expected an episode of"):
        slower.restore(kept)


def test_the_cache_of_states_is_bounded(case: ballast.Case, beds: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("gymnasium")
    from ballast import gym

    monkeypatch.setattr(gym, "MAX_CACHED_STATES", 2)
    env = gym.TampingEnv(case, seeds=[case.seed, 12], bed_cache=beds)
    for bed in (12, case.seed, 99, case.seed, 12):
        env._simulation_after_lift(bed)
    assert list(env._cached_states) == [case.seed, 12]


class Interrupted:
    """A simulation whose windows are interrupted after their first step."""

    def __init__(self, sim: ballast.Simulation) -> None:
        self.sim = sim

    def __getattr__(self, name: str) -> object:
        return getattr(self.sim, name)

    def advance_to(self, t1_ns: int, motions: dict[str, ballast.Motion], *, zones: bool) -> None:
        self.sim.advance_to(self.sim.now_ns + self.sim.step_ns, motions, zones=zones)
        raise KeyboardInterrupt


def test_interrupted_steps_can_be_repeated(case: ballast.Case, beds: Path) -> None:
    pytest.importorskip("gymnasium")
    from ballast.gym import TampingEnv

    def second(interrupted: bool) -> list[float]:
        env = TampingEnv(case, bed_cache=beds)
        env.reset(seed=1)
        env.step(np.array([0.0, 0.0, 1.0]))
        if interrupted:
            sim = env._sim
            env._sim = Interrupted(sim)  # type: ignore[assignment]
            with pytest.raises(KeyboardInterrupt):
                env.step(np.array([1.0, 1.0, 0.0]))
            env._sim = sim
        seen, *_ = env.step(np.array([1.0, -1.0, 1.0]))
        return [float(number) for number in seen]

    assert second(interrupted=True) == second(interrupted=False)


def test_studies_return_a_table_and_continue(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pd = pytest.importorskip("pandas")
    from ballast import study

    points = study.grid({"tamping.vibration.frequency_Hz": [30.0, 60.0], "seed": [case.seed]})
    first = study.run(case, points[:1], tmp_path / "study", jobs=1, bed_cache=beds, progress=False)
    assert first["error"].isna().all()
    file = next((tmp_path / "study").glob("*.json"))
    stamp = file.stat().st_mtime_ns
    bad = {"tamping.vibration.frequency_Hz": 30.0, "seed": 1, "solver.max_iterations": 1}
    # Points may come one by one.
    generated = (point for point in [*points, bad])
    table = study.run(case, generated, tmp_path / "study", jobs=2, bed_cache=beds, progress=False)
    assert file.stat().st_mtime_ns == stamp, "what is done is not done again"
    assert len(table) == 3 and list(table["seed"]) == [case.seed, case.seed, 1]
    pd.testing.assert_frame_equal(first, table.loc[:0, first.columns])
    assert table["work J"].iloc[0] != table["work J"].iloc[1]
    assert 0.2 < table["under/sleeper_1: final compactness"].iloc[0] < 0.9


def test_statistics_of_figures_over_beds(tmp_path: Path) -> None:
    import pandas as pd
    from ballast import study

    path = tmp_path / "table.csv"
    path.write_text("number,bed.seed,run.step_s,gain,case,done\n1,1,0.1,2,a,true\n2,2,0.1,4,a,true\n3,1,0.2,5,a,true\n")
    whole = study.statistics_over_beds(path)
    assert list(whole.loc["gain"]) == pytest.approx([11 / 3, 7**0.5 / 3**0.5, 2, 5, 3])
    assert "bed.seed" not in whole.index and "case" not in whole.index
    by_step = study.statistics_over_beds(pd.read_csv(path), by=["run.step_s"])
    assert list(by_step.loc[(0.1, "gain")]) == pytest.approx([3, 2**0.5, 2, 4, 2])
    assert by_step.loc[(0.2, "gain")]["count"] == 1
    with pytest.raises(ValueError, match="by: expected columns of the table, found \\['step'\\]"):
        study.statistics_over_beds(path, by=["step"])


def test_studies_without_points_return_an_empty_table(case: ballast.Case, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    table = study.run(case, [], tmp_path, progress=False)
    assert len(table) == 0 and table["error"].tolist() == []


def says_numbers_of_numpy(case: ballast.Case, beds: str) -> dict[str, object]:
    return {"real": np.float32(0.5), "whole": np.int64(3), "is": np.bool_(True), "none": None}


def says_text_of_numpy(case: ballast.Case, beds: str) -> dict[str, object]:
    return {"text": np.str_("a")}


def test_figures_are_numbers(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    with ThreadPoolExecutor(1) as pool:
        ask = {"executor": pool, "bed_cache": beds, "progress": False}
        table = study.run(case, [{}], tmp_path, measure=says_numbers_of_numpy, **ask)
        assert table.iloc[0].to_dict() == {"real": 0.5, "whole": 3, "is": True, "none": None, "error": None}
        table = study.run(case, [{}], tmp_path, measure=says_text_of_numpy, **ask)
    assert "expected a dictionary from names to numbers, found 'text': " in table["error"].iloc[0]


def the_seed(case: ballast.Case, beds: str) -> dict[str, float]:
    return {"figure": case.seed}


def test_studies_accept_seeds_beyond_toml(case: ballast.Case, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    greatest = 2**64 - 1
    for base, point in ((case, {"seed": greatest}), (case.choose(seed=greatest), {})):
        table = study.run(base, [point], tmp_path / "study", measure=the_seed, jobs=1, bed_cache=tmp_path / "beds", progress=False)
        assert table["error"].isna().all() and table["figure"].tolist() == [greatest], table["error"].tolist()


def test_result_files_describe_their_point(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    # As of a program that prepares another bed from the same case.
    assert _identity.point_key(case, "one", {}, the_seed) != _identity.point_key(case, "another", {}, the_seed)
    measure = functools.partial(the_seed)
    study.run(case, [{"seed": np.int64(case.seed)}], tmp_path, measure=measure, jobs=1, bed_cache=beds, progress=False)
    [file] = tmp_path.iterdir()
    reported = json.loads(file.read_text())
    assert (reported["case"], reported["seed"], reported["bed"]) == ("tiny", case.seed, case.bed_key)
    assert (reported["measure"], reported["version"]) == ("test_tools.the_seed", ballast.__version__)
    assert reported["point"] == {"seed": case.seed} and reported["figures"] == {"figure": case.seed}
    key = _identity.point_key(case, case.bed_key, {"seed": case.seed}, measure)
    assert file.name == f"{key}.json"


def no_finite_numbers(case: ballast.Case, beds: str) -> dict[str, float]:
    return {"not": math.nan, "more": math.inf}


def test_result_files_are_standard_json(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    ask = {"measure": no_finite_numbers, "jobs": 1, "bed_cache": beds, "progress": False}
    for _ in range(2):
        table = study.run(case, [{"tamping.squeeze.force_limit_N": math.inf}], tmp_path, **ask)  # type: ignore[arg-type]
        assert table["more"][0] == math.inf and math.isnan(table["not"][0])
    [file] = tmp_path.iterdir()
    reported = json.loads(file.read_text(), parse_constant=lambda text: pytest.fail(text))
    assert reported["point"] == {"tamping.squeeze.force_limit_N": "inf"}
    assert reported["figures"] == {"not": "nan", "more": "inf"}


def test_equal_points_are_run_once(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    axis = "tamping.vibration.frequency_Hz"
    points = [{axis: value} for value in (20, 20.0, np.float64(20), 20)] + [{axis: 20.5}]
    points += [{"bed.size_m": size} for size in ((0.5, 1), [0.5, 1.0], np.array([0.5, 1]))]
    keys = [_identity.point_key(case, case.bed_key, point, the_seed) for point in points]
    assert [keys.count(key) for key in keys] == [4] * 4 + [1] + [3] * 3
    table = study.run(case, points[:4], tmp_path, measure=the_seed, jobs=2, bed_cache=beds, progress=False)
    assert table["figure"].tolist() == [case.seed] * 4 and len([*tmp_path.iterdir()]) == 1
    table = study.run(case, points[:2], tmp_path, measure=fails, jobs=2, bed_cache=beds, progress=False)
    assert table["error"].notna().all(), "all are reported of what one of them has failed with"


def test_latin_hypercubes_fill_their_ranges() -> None:
    pytest.importorskip("scipy")
    from ballast import study

    points = study.latin_hypercube({"a": (0.0, 1.0), "b": (10.0, 20.0)}, 8, seed=1)
    assert points == study.latin_hypercube({"a": (0.0, 1.0), "b": (10.0, 20.0)}, 8, seed=1)
    for name, low, width in (("a", 0.0, 1.0), ("b", 10.0, 10.0)):
        cells = sorted(int(8 * (point[name] - low) / width) for point in points)
        assert cells == list(range(8))
    assert len(study.grid({"a": [1, 2], "b": [3, 4, 5]})) == 6
    ranges = {"seed": (1, 8), "solver.max_iterations": (5, 6), "b": (10, 20)}
    whole = study.latin_hypercube(ranges, 8, integers=["seed", "solver.max_iterations"])
    assert sorted(point["seed"] for point in whole) == list(range(1, 9))
    assert sorted(point["solver.max_iterations"] for point in whole) == [5] * 4 + [6] * 4
    assert all(isinstance(point["seed"], int) and isinstance(point["b"], float) for point in whole)
    with pytest.raises(ValueError, match=r"integers: expected some of .* found \['c'\]"):
        study.latin_hypercube(ranges, 8, integers=["c"])
    with pytest.raises(ValueError, match=r"range of 'seed', a whole number: .* found \(1\.5, 3\.2\)"):
        study.latin_hypercube({"seed": (1.5, 3.2)}, 8, integers=["seed"])
    for ends in ((2.0, 1.0), (0.0, math.nan), [1, 2, 3], ("a", "b"), 5):
        with pytest.raises(ValueError, match="range of 'b': expected .lowest, highest., found"):
            study.latin_hypercube({"b": ends}, 8)


def test_invalid_points_are_refused(case: ballast.Case, tmp_path: Path) -> None:
    from ballast import study

    for axes, said in (
        ({"a": 3}, "axis 'a': expected a list of values, found 3"),
        ({"solver.schedule": "synchronous"}, "axis 'solver.schedule': expected a list of values, found 'synchronous'"),
        (["a"], r"axes: expected a dictionary .*, found \['a'\]"),
    ):
        with pytest.raises(TypeError, match=said):
            study.grid(axes)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="axis 'b': expected at least one value, found none"):
        study.grid({"a": [1], "b": []})
    with pytest.raises(TypeError, match="point: expected a dictionary .*, found 'seed'"):
        study.apply(case, "seed")  # type: ignore[arg-type]
    for points, said in (
        ({"a": 40}, r"points: expected a list of points, .*, found \{'a': 40\}"),
        (40, "points: expected a list of points, .*, found 40"),
        ([{}, "a"], r"points\[1\]: expected a dictionary from key paths to values, found 'a'"),
    ):
        for ask in (lambda p: study.run(case, p, tmp_path / "study"), lambda p: study.write_sweep_plan("a.toml", p, tmp_path / "p.toml")):
            with pytest.raises(TypeError, match=said):
                ask(points)
    for jobs in (0, -1, 1.5, "2"):
        with pytest.raises(ValueError, match=f"jobs: expected a whole number, 1 or more, found {jobs!r}"):
            study.run(case, [{}], tmp_path / "study", jobs=jobs)  # type: ignore[arg-type]
    with ThreadPoolExecutor(1) as pool, pytest.raises(TypeError, match="run: jobs: expected none with executor"):
        study.run(case, [{}], tmp_path / "study", jobs=5, executor=pool)
    assert not list(tmp_path.iterdir())


def test_invalid_ranges_are_refused() -> None:
    pytest.importorskip("scipy")
    from ballast import study

    with pytest.raises(TypeError, match="ranges: expected a dictionary .* found 3"):
        study.latin_hypercube(3, 4)  # type: ignore[arg-type]
    for n in (2.5, -1):
        with pytest.raises(ValueError, match=f"n: expected a whole number, 0 or more, found {n}"):
            study.latin_hypercube({"a": (0.0, 1.0)}, n)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="integers: expected a list of names of axes, found 'seed'"):
        study.latin_hypercube({"seed": (1, 3)}, 4, integers="seed")


def test_sweep_plans_are_toml(case: ballast.Case, tmp_path: Path) -> None:
    from ballast import study

    point = {
        "a": {"mass_kg": 300, "z": "free", "odd key": [1, 2.5]},
        "b": [True, "text with \"quotes\", \\, \x7f and \U0001f600"],
        "c": -math.inf,
        "seed": np.int64(3),
    }
    study.write_sweep_plan("case \U0001f600.toml", [point], tmp_path / "plan.toml")
    reported = tomllib.loads((tmp_path / "plan.toml").read_text(encoding="utf-8"))
    assert reported["case"] == "case \U0001f600.toml"
    assert reported["points"] == [{**{k: v for k, v in point.items() if k != "seed"}, "bed.seed": 3}]
    study.write_sweep_plan("case.toml", [], tmp_path / "empty.toml")
    for name in ("plan.toml", "own.toml", "words"):
        case.write(tmp_path / "own.toml")
        (tmp_path / "words").write_text("some words")
        before = (tmp_path / name).read_bytes()
        if name == "plan.toml":
            study.write_sweep_plan("case \U0001f600.toml", [point], tmp_path / name)
        else:
            with pytest.raises(ballast.FileError, match="a new file, or a plan to replace, found another file"):
                study.write_sweep_plan("case.toml", [point], tmp_path / name)
        assert (tmp_path / name).read_bytes() == before
    with pytest.raises(TypeError, match=r"points\[1\].a: expected a string, number, .* found None"):
        study.write_sweep_plan("case.toml", [{"a": 1}, {"a": None}], tmp_path / "plan.toml")
    # Only one of them could be obeyed.
    for ask in (lambda point: study.write_sweep_plan("case.toml", [point], tmp_path / "plan.toml"), lambda point: study.apply(case, point)):
        with pytest.raises(ballast.CaseError, match="expected one seed of the bed, .* found 1 and 2") as wrong:
            ask({"seed": 1, "bed.seed": 2})
        assert wrong.value.code == "case"


def test_the_program_runs_sweep_plans(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    from conftest import ROOT

    from ballast import study

    program = ROOT / "target/release/ballast"
    if not program.exists():
        pytest.skip(f"{program} is not built")
    case.write(tmp_path / "tiny.toml")
    axes = {"tamping.vibration.frequency_Hz": np.array([30.0]), "seed": np.array([case.seed])}
    points = study.grid(axes)
    study.write_sweep_plan("tiny.toml", points, tmp_path / "plan.toml")
    called = [program, "sweep", tmp_path / "plan.toml", "--bed-cache", beds]
    done = subprocess.run(called, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = (tmp_path / "runs/plan/table.csv").read_text().splitlines()
    names, values = (row.split(",") for row in rows)
    row = dict(zip(names, values, strict=True))
    assert float(row["tamping.vibration.frequency_Hz"]) == 30.0
    figures = study.run_tamping_cycle(study.apply(case, points[0]), str(beds))
    after = float(row["compactness.under/sleeper_1.after"])
    assert figures["under/sleeper_1: final compactness"] == pytest.approx(after, abs=1e-12)


MEASURES = """
def seed_times(case, beds, *, factor=1.0):
    return {"figure": factor * case.seed}
"""


def test_changed_measures_run_again(
    case: ballast.Case, beds: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    file = tmp_path / "measures_of_a_test.py"
    file.write_text(MEASURES)
    monkeypatch.syspath_prepend(tmp_path)
    module = importlib.import_module(file.stem)

    def figure(factor: float | None = None) -> float:
        measure = module.seed_times
        if factor is not None:
            measure = functools.partial(measure, factor=factor)
        points = study.grid({"seed": np.array([case.seed])})
        folder = tmp_path / "study"
        with ThreadPoolExecutor(1) as pool:
            table = study.run(
                case, points, folder, measure=measure, executor=pool, bed_cache=beds, progress=False
            )
        assert table["error"].isna().all(), table["error"]
        return float(table["figure"].iloc[0] / case.seed)

    assert [figure(), figure(2.0), figure(np.float64(3.0)), figure(), figure(2.0)] == [1, 2, 3, 1, 2]
    done = {file: file.stat().st_mtime_ns for file in (tmp_path / "study").iterdir()}
    assert len(done) == 3
    file.write_text(MEASURES.replace("factor *", "10.0 * factor *"))
    importlib.reload(module)
    assert figure() == 10.0 and figure(2.0) == 20.0
    assert {file: file.stat().st_mtime_ns for file in done} == done

    # What computes is what was read, whatever the file says by now.
    file.write_text(MEASURES.replace("factor *", "7.0 * factor *"))
    assert figure() == 10.0
    importlib.reload(module)
    assert figure() == 7.0
    file.write_text(MEASURES)
    ask = {"measure": module.seed_times, "jobs": 1, "bed_cache": beds, "progress": False}
    table = study.run(case, [{}], tmp_path / "elsewhere", **ask)
    assert "that the study was started with, found other code" in table["error"].iloc[0]

    def reported(measure: study.Measure) -> float:
        with ThreadPoolExecutor(1) as pool:
            table = study.run(
                case, [{}], tmp_path / "taken", measure=measure, executor=pool, bed_cache=beds, progress=False
            )
        return float(table["figure"].iloc[0] - case.seed)

    def taking(more: object) -> study.Measure:
        return lambda case, beds: {"figure": case.seed + more}  # type: ignore[operator]

    def defaulting(more: float) -> study.Measure:
        return lambda case, beds, more=more: {"figure": case.seed + more}

    def calling(more: float) -> study.Measure:
        figure = taking(more)
        return lambda case, beds: figure(case, beds)

    def decorated(more: float) -> study.Measure:
        @functools.wraps(module.seed_times)
        def measure(case: ballast.Case, beds: str) -> dict[str, float]:
            return {"figure": case.seed + more}

        return measure

    for made in (taking, defaulting, calling, decorated):
        assert [reported(made(1)), reported(made(2)), reported(made(1))] == [1, 2, 1], made
    # All three are on one source line. The last two differ only in an inner function.
    a, b, c = (lambda c, _: {"figure": c.seed + 1}), (lambda c, _: {"figure": c.seed + (lambda: 2)()}), (lambda c, _: {"figure": c.seed + (lambda: 3)()})  # fmt: skip
    assert [reported(a), reported(b), reported(c), reported(a)] == [1, 2, 3, 1]
    with pytest.raises(TypeError, match="closes over, identify its results, and one cannot .*object"):
        reported(taking(object()))
    with pytest.raises(TypeError, match="measure: expected a Python function, .* found <bound method"):
        reported(Measures().figure)
    assert _identity.code_digest(module.seed_times) == _identity.code_digest(pickle.loads(pickle.dumps(module.seed_times)))
    with pytest.raises(TypeError, match="measure: expected a Python function, .* found <built-in"):
        study.run(case, [{}], tmp_path, measure=len, progress=False)  # type: ignore[arg-type]


class Measures:
    def figure(self, case: ballast.Case, beds: str) -> dict[str, float]:
        return {"figure": 1.0}


def ends(case: ballast.Case, beds: str) -> dict[str, float]:
    sys.exit(3)


def says_nothing(case: ballast.Case, beds: str) -> None:
    return None


def says_the_seed(case: ballast.Case, beds: str) -> dict[str, float]:
    return {"seed": 99.0}


@pytest.mark.parametrize(
    ("measure", "said"),
    [(ends, "SystemExit: 3"), (says_nothing, "expected a dictionary .* found None"), (says_the_seed, "other names .* 'seed'")],
)
def test_failed_measures_are_reported_and_repeated(
    case: ballast.Case, beds: Path, tmp_path: Path, measure, said: str
) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    for _ in range(2):
        with ThreadPoolExecutor(1) as pool:
            table = study.run(
                case, [{"seed": case.seed}], tmp_path / "study", measure=measure, executor=pool, bed_cache=beds, progress=False
            )
        assert re.search(said, table["error"].iloc[0]), table["error"].iloc[0]
        assert table["seed"].tolist() == [case.seed]
    assert not list((tmp_path / "study").iterdir())


def test_invalid_cases_and_damaged_files_raise(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    wrong = {"tamping.vibration.frequency_Hz": -1.0}
    with pytest.raises(ballast.CaseError, match=r"point \{'tamping.vibration.frequency_Hz': -1.0\}: "):
        study.run(case, [{}, wrong], tmp_path / "study", bed_cache=beds, progress=False)
    for point, said in (
        ({"seed": "7"}, "seed: expected a whole number, found '7'"),
        ({"run.step_s": None}, "run.step_s: expected a string, number, .* found None"),
    ):
        with pytest.raises(TypeError, match=f"{re.escape(f'point {point}: ')}{said}"):
            study.run(case, [{}, point], tmp_path / "study", bed_cache=beds, progress=False)
    key = _identity.point_key(case, case.bed_key, {}, fails)
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / f"{key}.json").write_text("{")
    with pytest.raises(ballast.FileError, match=f"{key}.json: expected the figures of a point") as damaged:
        study.run(case, [{}], tmp_path / "study", measure=fails, bed_cache=beds, progress=False)
    assert damaged.value.code == "file"


def fails(case: ballast.Case, beds: str) -> dict[str, float]:
    raise ValueError(f"no figures of {case.name}")


def test_errors_include_the_source_line(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    table = study.run(
        case, [{"seed": case.seed}], tmp_path, measure=fails, jobs=1, bed_cache=beds, progress=False
    )
    [said] = table["error"]
    assert re.fullmatch(r"ValueError: no figures of tiny \(test_tools.py:\d+, in fails\)", said)
    assert not list(tmp_path.glob("*.json"))


class Odd(Exception):
    """An exception that cannot be unpickled: its constructor needs two arguments."""

    def __init__(self, what: str, where: str) -> None:
        super().__init__(f"{what} at {where}")


class OddNumber(float):
    def __reduce__(self) -> tuple[object, ...]:
        return float, ("no number",)


def is_odd(case: ballast.Case, beds: str) -> dict[str, object]:
    frequency = case.to_dict()["tamping"]["vibration"]["frequency_Hz"]
    if frequency == 30.0:
        raise Odd("no figures", "30 Hz")
    if frequency == 40.0:
        return {"figure": (lambda: 1)}
    return {"figure": OddNumber(frequency)}


@pytest.mark.parametrize("processes", [True, False])
def test_unpicklable_exceptions_and_figures_are_reported(
    case: ballast.Case, beds: Path, tmp_path: Path, processes: bool
) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    points = study.grid({"tamping.vibration.frequency_Hz": [30.0, 40.0, 50.0, 60.0]})
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        by = {"jobs": 2} if processes else {"executor": pool}
        table = study.run(case, points, tmp_path, measure=is_odd, bed_cache=beds, progress=False, **by)  # type: ignore[arg-type]
    odd, no_number = table["error"].iloc[:2]
    assert re.fullmatch(r"Odd: no figures at 30 Hz \(test_tools.py:\d+, in is_odd\)", odd)
    assert no_number.startswith("TypeError: measure: expected a dictionary from names to numbers, found 'figure': <function")
    assert table["error"].iloc[2:].isna().all() and table["figure"].iloc[2:].tolist() == [50.0, 60.0]


def is_killed_at_60(case: ballast.Case, beds: str) -> dict[str, float]:
    frequency = case.to_dict()["tamping"]["vibration"]["frequency_Hz"]
    if frequency == 60.0:
        os.kill(os.getpid(), signal.SIGKILL)
    return {"figure": frequency}


def test_a_killed_process_fails_only_its_point(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    points = study.grid({"tamping.vibration.frequency_Hz": [30.0, 60.0, 40.0, 50.0]})
    table = study.run(case, points, tmp_path, measure=is_killed_at_60, jobs=2, bed_cache=beds, progress=False)
    assert table["figure"].fillna(0.0).tolist() == [30.0, 0.0, 40.0, 50.0]
    assert table["error"].isna().tolist() == [True, False, True, True]
    assert re.search("BrokenProcessPool: its process was killed", table["error"].iloc[1])


def test_scripts_need_no_main_guard_for_a_study(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    case.write(tmp_path / "tiny.toml")
    script = tmp_path / "study.py"
    script.write_text(
        "from ballast import study\n"
        "print('begun', flush=True)\n"
        "def seed(case, beds):\n"
        "    return {'figure': case.seed}\n"
        f"points = [{{'seed': {case.seed}}}]\n"
        f"print(study.run('tiny.toml', points, 'study', measure=seed, jobs=1, bed_cache={str(beds)!r}).figure.tolist())\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path, check=True)
    assert done.stdout.splitlines() == ["begun", f"[{case.seed}]"]


def test_measures_without_a_module_are_sent_by_value(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    more = 3
    table = study.run(
        case, [{}], tmp_path / "study", measure=lambda case, beds: {"figure": case.seed + more}, jobs=1, bed_cache=beds,
        progress=False,
    )  # fmt: skip
    assert table["figure"].tolist() == [case.seed + 3]
    # In a notebook cell the source exists only in the cache of lines.
    case.write(tmp_path / "tiny.toml")
    cell = (
        "import functools, linecache, sys\n"
        "from ballast import study\n"
        "text = 'def seed(case, beds, more=0): return {\"figure\": case.seed + more}'\n"
        "linecache.cache['<cell>'] = len(text), None, [text], '<cell>'\n"
        "exec(compile(text, '<cell>', 'exec'))\n"
        "for measure in (seed, functools.partial(seed, more=1)):\n"
        "    table = study.run('tiny.toml', [{}], 'study', measure=measure, bed_cache=sys.argv[1], jobs=1, progress=False)\n"
        "    print(table.figure.tolist())\n"
    )
    done = subprocess.run([sys.executable, "-c", cell, beds], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [f"[{case.seed}]", f"[{case.seed + 1}]"]


def test_measures_that_cannot_be_pickled_are_refused(case: ballast.Case, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    names = {"lock": threading.Lock(), "__name__": "__main__"}
    exec("def measure(case, beds):\n    return {'figure': lock}", names)
    with pytest.raises(TypeError, match="can be sent to other processes, found <function measure .*cannot pickle"):
        study.run(case, [{}], tmp_path / "study", measure=names["measure"], bed_cache=tmp_path / "beds", progress=False)


def test_missing_packages_are_reported_before_any_work(
    case: ballast.Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ballast import study

    for missing in ("pandas", "loky"):
        with monkeypatch.context() as patch:
            patch.setitem(sys.modules, missing, None)
            with pytest.raises(ImportError, match=f"study.run: {missing} is not installed; pip install"):
                study.run(case, [{}], tmp_path / "study", bed_cache=tmp_path / "beds")
    assert not list(tmp_path.iterdir())


def test_an_unwritable_stderr_ends_no_study(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    case.write(tmp_path / "tiny.toml")
    code = (
        "import os, sys, ballast\n"
        "from ballast import study\n"
        "read, write = os.pipe()\n"
        "os.close(read)\n"
        "os.dup2(write, 2)\n"
        "ballast.prepare('tiny.toml', bed_cache='beds')\n"
        "table = study.run('tiny.toml', [{}], 'study', measure=lambda case, beds: {'figure': 1.0}, jobs=1, bed_cache='beds')\n"
        "sys.stderr.close()\n"
        "study.run('tiny.toml', [{}], 'again', measure=lambda case, beds: {'figure': 1.0}, jobs=1, bed_cache='beds')\n"
        "print(table.figure.tolist())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, cwd=tmp_path)
    assert (done.returncode, done.stdout) == (0, "[1.0]\n")


# The first point takes no time, the others more than a test.
SLOW = """
import os, pathlib, time
from ballast import study

def slow(case, beds):
    frequency = case.to_dict()["tamping"]["vibration"]["frequency_Hz"]
    pathlib.Path(f"begun_{frequency}").write_text(str(os.getpid()))
    if frequency > 1.0:
        time.sleep(600.0)
    return {"figure": frequency}

if __name__ == "__main__":
    points = study.grid({"tamping.vibration.frequency_Hz": [1.0, 30.0, 40.0, 50.0]})
    study.run("tiny.toml", points, "study", measure=slow, jobs=2, bed_cache=BEDS)
"""


@contextmanager
def slow_study(case: ballast.Case, beds: Path, folder: Path) -> Iterator[tuple[subprocess.Popen[str], list[int]]]:
    """Yields a study whose first point is done, and the processes of the second and third."""
    case.write(folder / "tiny.toml")
    (folder / "slow.py").write_text(SLOW.replace("BEDS", repr(str(beds))))
    called = [sys.executable, "slow.py"]
    study = subprocess.Popen(called, cwd=folder, stderr=subprocess.PIPE, text=True, start_new_session=True)
    begun = [folder / f"begun_{frequency}" for frequency in (30.0, 40.0)]
    try:
        until(lambda: all(file.exists() and file.read_text() for file in begun))
        until(lambda: any((folder / "study").glob("*.json")))
        yield study, [int(file.read_text()) for file in begun]
    finally:
        # Whatever of it is left where a test fails.
        with suppress(ProcessLookupError):
            os.killpg(study.pid, signal.SIGKILL)
        study.communicate()


def until(is_so: Callable[[], bool], seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not is_so():
        assert time.monotonic() < end, f"not so after {seconds} s"
        time.sleep(0.05)


def has_ended(process: int) -> bool:
    try:
        # A zombie has ended, too.
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")


@needs_proc
def test_killed_studies_leave_no_processes(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    with slow_study(case, beds, tmp_path) as (study, processes):
        assert not any(map(has_ended, processes))
        study.kill()
        until(lambda: all(map(has_ended, processes)))


@needs_proc
def test_ctrl_c_ends_a_study_and_keeps_results(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    with slow_study(case, beds, tmp_path) as (study, processes):
        # The stop button of a notebook signals only this process.
        study.send_signal(signal.SIGINT)
        _, said = study.communicate(timeout=120)
        assert all(map(has_ended, processes))
    assert study.returncode != 0 and said.count("Traceback") == 1 and said.rstrip().endswith("KeyboardInterrupt"), said
    [done] = (tmp_path / "study").iterdir()
    assert json.loads(done.read_text())["figures"] == {"figure": 1.0}
    assert not (tmp_path / "begun_50.0").exists()


def interrupts(case: ballast.Case, beds: str) -> dict[str, float]:
    INTERRUPTED.append(case.seed)
    time.sleep(0.05)
    raise KeyboardInterrupt


INTERRUPTED: list[int] = []


def test_ctrl_c_cancels_waiting_futures(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    from ballast import study

    points = study.grid({"tamping.vibration.frequency_Hz": range(20, 60)})
    with ThreadPoolExecutor(1) as pool, pytest.raises(KeyboardInterrupt):
        study.run(case, points, tmp_path, measure=interrupts, executor=pool, bed_cache=beds, progress=False)
    assert 1 <= len(INTERRUPTED) < len(points)


def test_studies_run_on_dask(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    distributed = pytest.importorskip("distributed")
    from ballast import study

    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster, distributed.Client(cluster) as client:
        table = study.run(
            case, [{"seed": case.seed}], tmp_path, executor=client, bed_cache=beds, progress=False
        )
    assert table["error"].isna().all() and table["work J"].iloc[0] > 0.0


def test_plots_and_results_of_a_run(sim: ballast.Simulation, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    from conftest import ROOT

    from ballast import plot

    program = ROOT / "target/release/ballast"
    if not program.exists():
        pytest.skip(f"{program} is not built")
    case = tmp_path / "tiny.toml"
    sim.case.write(case)
    called = [program, "run", case, "--out", tmp_path / "run", "--bed-cache", tmp_path / "beds"]
    subprocess.run(called, check=True, capture_output=True)
    results = ballast.read(tmp_path / "run/results.vtkhdf")
    assert isinstance(results, ballast.Results)
    assert set(plot.tines(results)) == {t.name for t in sim.tines}
    assert plot.tines(tmp_path / "run") == plot.tines(results)
    positions, orientations = results.poses(0)
    assert positions.shape == (results.grain_count + len(results.bodies), 3)
    assert np.allclose(np.linalg.norm(orientations, axis=1), 1.0)
    assert np.array_equal(positions[: sim.grain_count], sim.save().positions)
    for backwards, beyond in ((-1, len(results.steps)), (-len(results.steps), -len(results.steps) - 1)):
        assert np.array_equal(results.poses(backwards)[0], results.poses(backwards + len(results.steps))[0])
        with pytest.raises(IndexError, match=f"frame: expected -{len(results.steps)} to .*, found {beyond}"):
            results.poses(beyond)
    assert repr(results) == f'Results("tiny", {len(results.steps)} frames)'
    for ask in (results.table, results.units):
        with pytest.raises(KeyError, match="table: expected one of steps, zones, found nope"):
            ask("nope")
    for unknown in ("results", "results.h5", "results.mcap"):
        (tmp_path / unknown).write_bytes((tmp_path / "run/results.vtkhdf").read_bytes())
        assert isinstance(ballast.read(tmp_path / unknown), ballast.Results)
    (tmp_path / "checkpoint.vtkhdf").write_bytes((tmp_path / "run/checkpoint.h5").read_bytes())
    assert isinstance(ballast.read(tmp_path / "checkpoint.vtkhdf"), ballast.State)
    steps = results.table("steps")
    assert len(steps["time"]) == 180 and results.units("steps")["time"] == "s"
    figure = plot.overview(results)
    figure.savefig(tmp_path / "overview.png")
    loops = figure.axes[2].lines
    assert len(loops) == 2 and all(len(line.get_xdata()) > 20 for line in loops)
    for window_s, n in ((0.004, 4), (0.0013, 1), (1e-9, 1), (10.0, 180), (math.inf, 180)):
        ax = plot.forces(results, window_s=window_s)
        assert ax.get_ylabel() == f"force, mean over {n} ms, kN"
        force = np.linalg.norm(_last_rows(steps, "tine_1_plus", n).mean(axis=0))
        assert ax.lines[0].get_label() == "tine_1_plus" and ax.lines[0].get_ydata()[-1] == pytest.approx(1e-3 * force)
    for window_s in (0.0, -1.0, math.nan):
        for draw in (plot.forces, plot.loops):
            with pytest.raises(ValueError, match=f"window_s: expected a number above 0, found {window_s}"):
                draw(results, window_s=window_s)
    # The cycle of Python is that of the program: the same steps end with the same hash.
    for _ in range(180):
        sim.step_tamping_cycle()
    checkpoint = ballast.read(tmp_path / "run/checkpoint.h5")
    assert isinstance(checkpoint, ballast.State)
    # The folder stands for its files.
    in_folder = ballast.read(tmp_path / "run")
    assert isinstance(in_folder, ballast.Results) and np.array_equal(in_folder.times, results.times)
    with ballast.resume(str(tmp_path / "run"), threads=1) as resumed:
        assert resumed.save().hash == checkpoint.hash
    with pytest.raises(ballast.FileError, match="results.vtkhdf"):
        ballast.read(tmp_path)
    assert sim.save().hash == checkpoint.hash
    assert np.array_equal(checkpoint.contact_impulses, sim.save().contact_impulses)


def _last_rows(steps: dict[str, np.ndarray], body: str, n: int) -> np.ndarray:
    return np.stack([steps[f"{body}_force_{axis}"][-n:] for axis in "xyz"], axis=1)


def test_read_detects_the_kind_of_a_file(sim: ballast.Simulation, tmp_path: Path) -> None:
    sim.save().write(tmp_path / "state")
    assert isinstance(ballast.read(tmp_path / "state"), ballast.State)
    sim.record(tmp_path / "recording.h5")
    sim.advance_to(sim.step_ns)
    sim.stop_recording()
    assert isinstance(ballast.read(tmp_path / "recording.h5"), ballast.Recording)
    # The reader reports files of other kinds, and a pipe does not block.
    (tmp_path / "text").write_text("some words")
    os.mkfifo(tmp_path / "pipe.mcap")
    for name in ("text", "none.h5", "pipe.mcap"):
        with pytest.raises(ballast.FileError, match=name):
            ballast.read(tmp_path / name)


def test_state_files_replace_only_checkpoints(sim: ballast.Simulation, tmp_path: Path) -> None:
    state, path = sim.save(), tmp_path / "state.h5"
    for content in (b"some words", b"\x89HDF\r\n\x1a\n", sim.case.text.encode()):
        path.write_bytes(content)
        with pytest.raises(ballast.FileError, match="a new file, or a .*checkpoint.* to replace, found another"):
            state.write(path)
        assert path.read_bytes() == content
    for wrong, found in ((tmp_path, "a folder"), (Path("/dev/null"), "a device or a pipe")):
        with pytest.raises(ballast.FileError, match=f"found {found}"):
            state.write(wrong)
    path.write_bytes(b"")
    for _ in range(2):
        state.write(path)
    assert ballast.State.read(path).hash == state.hash


def test_truncation_is_reported_once(sim: ballast.Simulation, tmp_path: Path) -> None:
    sim.record(tmp_path / "whole.mcap")
    for _ in range(4):
        sim.advance_to(sim.now_ns + sim.step_ns)
    sim.stop_recording()
    whole = (tmp_path / "whole.mcap").read_bytes()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        recording = ballast.Recording(tmp_path / "whole.mcap")
        assert len(list(recording)) == 4 and recording.truncation is None
        # Within what was asked and answered, as a kill may leave it, or a bad disk.
        at = len(whole) // 2
        (tmp_path / "cut.mcap").write_bytes(whole[:at])
        (tmp_path / "damaged.mcap").write_bytes(whole[:at] + bytes([whole[at] ^ 1]) + whole[at + 1 :])
        damaged = ballast.Recording(tmp_path / "damaged.mcap")
        seen: list[object] = []
        with pytest.raises(ballast.FileError, match="damaged.mcap: damaged: "):
            seen.extend(damaged)
        assert len(seen) < 4 and damaged.truncation and list(damaged) == []
    cut = ballast.Recording(tmp_path / "cut.mcap")
    with pytest.warns(RuntimeWarning, match="cut.mcap: ") as reported:
        assert len(list(cut)) < 4
    assert len(reported) == 1 and cut.truncation and str(reported[0].message).endswith(cut.truncation)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert list(cut) == []


def test_reading_releases_the_interpreter(tmp_path: Path) -> None:
    path, size, ticks = tmp_path / "results.vtkhdf", 1 << 30, []
    is_over = threading.Event()

    def tick() -> None:
        while not is_over.wait(0.001):
            ticks.append(time.monotonic())

    with path.open("wb") as file:
        # Its seal is compared with all that comes before it.
        file.truncate(size)
        file.seek(size)
        file.write(f"ballast-results-end 1\nbytes {size}\nblake3 {'0' * 64}\n".encode().ljust(512, b"\n"))
    clock = threading.Thread(target=tick)
    clock.start()
    try:
        begin = time.monotonic()
        with pytest.raises(ballast.FileError):
            ballast.Results(path)
        end = time.monotonic()
    finally:
        is_over.set()
        clock.join()
    assert end - begin > 0.05 and sum(begin < at < end for at in ticks) > 5, (end - begin, len(ticks))


def test_plots_find_tines_of_any_name(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib").use("Agg")
    from conftest import ROOT, renamed

    from ballast import plot

    program = ROOT / "target/release/ballast"
    if not program.exists():
        pytest.skip(f"{program} is not built")
    # Its vibration carries a blade farther than this stroke.
    renamed(case, stroke_m=0.001).write(tmp_path / "own.toml")
    called = [program, "run", tmp_path / "own.toml", "--bed-cache", beds, "--out"]
    subprocess.run([*called, tmp_path / "run"], check=True, capture_output=True)
    results = ballast.read(tmp_path / "run/results.vtkhdf")
    assert isinstance(results, ballast.Results)
    assert plot.tines(results) == ["left", "right"]
    assert [line.get_label() for line in plot.forces(results).lines] == ["left", "right"]
    steps = results.table("steps")
    squeeze = steps["phase"] == plot.SQUEEZE_PHASE
    for line, inwards in zip(plot.loops(results).lines, (1.0, -1.0), strict=True):
        x = steps[f"{line.get_label()}_x"][squeeze]
        assert np.allclose(line.get_xdata(), 1e3 * inwards * (x - x[0]))
    # Tines without a mount come after the walls, a sleeper with one before all others.
    values = case.to_dict()
    values["sleepers"]["mount"] = {"mass_kg": 2, "z": "spring", "stiffness_N_per_m": 1e6}
    rigid, sprung = case.with_values({"tines.mount.rigid": True}), ballast.Case.from_dict(values)
    for name, own in (("rigid", rigid), ("sprung", sprung)):
        own.write(tmp_path / f"{name}.toml")
        called[2:3] = [tmp_path / f"{name}.toml"]
        subprocess.run([*called, tmp_path / name, "--steps", "5"], check=True, capture_output=True)
        assert plot.tines(tmp_path / name / "results.vtkhdf") == ["tine_1_plus", "tine_1_minus"], name
    # A run that ends before its squeeze has no loops, and matplotlib does not warn.
    subprocess.run([*called, tmp_path / "short", "--steps", "5"], check=True, capture_output=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = plot.overview(tmp_path / "short/results.vtkhdf")
    assert not figure.axes[2].lines and figure.axes[2].get_legend() is None
    assert [text.get_text() for text in figure.axes[2].texts] == ["no step in the squeeze phase"]


def test_plots_accept_the_folder_of_a_run(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    from ballast import plot

    for folder in (tmp_path, str(tmp_path)):
        with pytest.raises(ballast.FileError, match=re.escape(str(tmp_path / "results.vtkhdf"))):
            plot.tines(folder)


def test_failed_pictures_close_the_plotter(
    sim: ballast.Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ballast import view

    closed: list[bool] = []

    class Plotter:
        def screenshot(self, path: str) -> None:
            raise FileNotFoundError(path)

        def close(self) -> None:
            closed.append(True)

    monkeypatch.setattr(view, "scene", lambda sim, **options: Plotter())
    with pytest.raises(FileNotFoundError):
        view.save_picture(sim, "nowhere/bed.png")
    assert closed == [True]


def test_pictures(sim: ballast.Simulation, tmp_path: Path) -> None:
    pytest.importorskip("pyvista")
    from ballast import view

    sim.advance_to(5 * sim.step_ns)
    surface = view.bed(sim)
    grains = (surface.extract_cells(surface["grain"] == g) for g in (0, 1))
    volume = sum(grain.extract_surface(algorithm="dataset_surface").volume for grain in grains)
    assert volume == pytest.approx(sim.masses[:2].sum() / 2700.0, rel=0.05)
    assert view.force_chains(sim).n_cells > 0
    assert sim.parts("sleeper_1") and not sim.parts("floor")
    low, high = np.reshape(view.driven_bodies(sim).bounds, (3, 2)).T
    tine = sim.tines[0]
    assert np.all(low < tine.start) and np.all(tine.start < high)
    with pytest.raises(KeyError, match="tine_1"):
        sim.parts("tine_9")
    drawing = (
        "import sys, importlib.util, ballast, ballast.view as view\n"
        "sim = ballast.resume(sys.argv[1], threads=1)\n"
        "view.save_picture(sim, sys.argv[2])\n"
        "view.save_picture(sim, sys.argv[3], forces=True)\n"
        "if importlib.util.find_spec('trame_vtk'): view.save_page(sim, 'bed.html', forces=True)"
    )
    state, speeds, forces = (tmp_path / name for name in ("state.h5", "speeds.png", "forces.png"))
    sim.save().write(state)

    from conftest import drawing_fault

    if fault := drawing_fault():
        pytest.skip(f"nothing can be drawn here: {fault}")
    called = [sys.executable, "-c", drawing, state, speeds, forces]
    done = subprocess.run(called, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert speeds.stat().st_size > 5000 and forces.stat().st_size > 5000
    assert speeds.read_bytes() != forces.read_bytes()
    pytest.importorskip("trame_vtk")
    arrays, chains = arrays_of_page(tmp_path / "bed.html", "tiny"), view.force_chains(sim)
    for name, expected in (("Points", surface.points), ("Points", chains.points), ("force, N", chains["force, N"])):
        assert any(n == name and np.array_equal(a, expected.ravel()) for n, a in arrays)


def arrays_of_page(path: Path, title: str) -> list[tuple[str, np.ndarray]]:
    """Returns names and values of the arrays of numbers in a page of `save_page`."""
    page = path.read_text()
    assert f"<title>{title}</title>" in page
    # Nothing is loaded from elsewhere.
    assert not re.search(r"<(script|link|img)[^>]*(src|href)=", page)
    [packed] = re.findall(r'base64Str = "([A-Za-z0-9+/=]+)"', page)
    with zipfile.ZipFile(io.BytesIO(base64.b64decode(packed))) as archive:
        scene = json.loads(archive.read("index.json"))
    arrays, waiting = [], [scene["scene"]]
    while waiting:
        part = waiting.pop()
        if isinstance(part, list):
            waiting += part
        elif isinstance(part, dict):
            waiting += part.values()
            kind = {"Float32Array": np.float32, "Float64Array": np.float64}.get(part.get("dataType"))
            if kind:
                content = base64.b64decode(scene["hashes"][part["hash"]]["content"])
                arrays.append((str(part["name"]), np.frombuffer(content, kind)))
    return arrays

"""Cases, beds and inputs from Python."""

from __future__ import annotations

import copy
import math
import pickle
from pathlib import Path

import ballast
import numpy as np
import pytest
from ballast import _ballast
from conftest import ROOT


def test_examples_are_cases() -> None:
    for path in sorted((ROOT / "examples").glob("*.toml")):
        case = ballast.Case.load(path)
        assert case.name == path.stem
        assert case.duration_ns % case.step_ns == 0


def test_case_errors_report_all_faults_with_lines() -> None:
    text = (ROOT / "examples/first.toml").read_text()
    text = text.replace("step_s = 8e-4", "step_s = -1").replace("max_iterations = 400", "max_iteration = 4")
    with pytest.raises(ballast.CaseError) as wrong:
        ballast.Case(text, "mine.toml")
    assert wrong.value.code == "case"
    found = {fault["key"]: fault for fault in wrong.value.diagnostics}
    lines = text.splitlines()
    assert lines[found["run.step_s"]["line"] - 1].startswith("step_s = -1")
    assert "mine.toml" in str(wrong.value)
    assert any("iteration" in key for key in found)


def test_with_values_changes_a_case(case: ballast.Case, tmp_path: Path) -> None:
    other = case.with_values({"tamping.vibration.frequency_Hz": 42.0, "bed.seed": 8})
    assert other.to_dict()["tamping"]["vibration"]["frequency_Hz"] == 42.0
    assert (other.seed, case.seed) == (8, 7)
    values = {"tamping.vibration.frequency_Hz": np.float32(42), "bed.seed": np.int64(8)}
    assert case.with_values(values).seed == 8
    box = case.with_values({"bed.size_m": np.array([0.26, 0.1, 0.3])}).to_dict()["bed"]["size_m"]
    assert box == [0.26, 0.1, 0.3]
    with pytest.raises(TypeError, match=r"expected .* found 1j \(complex\)"):
        case.with_values({"bed.seed": 1j})
    assert other.bed_key != case.bed_key
    other.write(tmp_path / "other.toml")
    again = ballast.Case.load(tmp_path / "other.toml")
    assert again.to_dict() == other.to_dict() == ballast.Case.from_dict(other.to_dict()).to_dict()
    with pytest.raises(ballast.CaseError):
        case.with_values({"tamping.vibration.frequency_Hz": -1.0})
    with pytest.raises(ballast.CaseError):
        case.with_values({"name.deeper": 1})
    with pytest.raises(ballast.CaseError, match="at most 16 parts, found 300001"):
        case.with_values({"a" + ".a" * 300_000: 1})
    with pytest.raises(ballast.CaseError):
        ballast.Case.from_dict({"name": "nothing else"})


def test_to_dict_accepts_all_toml_that_cases_accept(case: ballast.Case) -> None:
    # A mark of the order of bytes, and lines within a table, which Python's own reader of TOML does not take.
    text = "\ufeff" + case.text + "\n[[sleeper]]\nblocks = [{\n    size_m = [1.0, 1.0, 1.0],\n}]\n"
    assert _ballast._parse_toml(text)["sleeper"][0]["blocks"] == [{"size_m": [1.0, 1.0, 1.0]}]
    marked = ballast.Case("\ufeff" + case.text)
    assert marked.to_dict() == case.to_dict()
    assert marked.with_values({"bed.seed": 9}).seed == 9


def test_cases_are_written_atomically(case: ballast.Case, tmp_path: Path) -> None:
    path, old = tmp_path / "case.toml", tmp_path / "old.toml"
    path.write_text("old = 1")
    old.hardlink_to(path)
    case.write(path)
    assert (path.read_text(), old.read_text()) == (case.text, "old = 1")
    with pytest.raises(ballast.FileError, match="found a folder"):
        case.write(tmp_path)
    assert sorted(tmp_path.iterdir()) == [path, old]


def test_write_replaces_only_cases(case: ballast.Case, tmp_path: Path) -> None:
    path = tmp_path / "notes"
    for content in (b"some words", b"\x89HDF\r\n\x1a\n", b"\xff"):
        path.write_bytes(content)
        with pytest.raises(ballast.FileError, match="expected a new file, or a case to replace, found another file"):
            case.write(path)
        assert path.read_bytes() == content
    with pytest.raises(ballast.FileError, match="found a device or a pipe"):
        case.write(Path("/dev/null"))
    path.write_bytes(b"")
    for _ in range(2):
        case.write(path)
    assert path.read_text() == case.text


def test_written_cases_include_choices(case: ballast.Case, tmp_path: Path) -> None:
    chosen = case.choose(seed=5, schedule="sequential")
    chosen.write(tmp_path / "chosen.toml")
    for again in (ballast.Case.load(tmp_path / "chosen.toml"), ballast.Case(chosen.text), ballast.Case.from_dict(chosen.to_dict())):
        assert (again.seed, again.schedule, again.bed_key) == (5, "sequential", chosen.bed_key)
    assert chosen.to_dict()["name"] == case.name
    # Comments stay where nothing changes.
    assert case.choose(seed=case.seed, schedule=case.schedule).text == case.text
    greatest = case.choose(seed=2**64 - 1)
    assert greatest.seed == 2**64 - 1
    for ask in (lambda: greatest.text, greatest.to_dict, lambda: greatest.write(tmp_path / "greatest.toml")):
        with pytest.raises(ballast.CaseError, match=f"bed.seed: expected at most {2**63 - 1} .*found {2**64 - 1}") as wrong:
            ask()
        assert wrong.value.code == "case"
    assert [path.name for path in tmp_path.iterdir()] == ["chosen.toml"]


def test_cases_are_copied_pickled_and_compared(case: ballast.Case) -> None:
    greatest = case.choose(seed=2**64 - 1, schedule="sequential")
    for one in (case, case.choose(seed=5), greatest):
        for other in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
            assert other == one and hash(other) == hash(one)
            assert (other.name, other.seed, other.schedule, other.bed_key) == (one.name, one.seed, one.schedule, one.bed_key)
    assert pickle.loads(pickle.dumps(case)).text == case.text
    assert case.choose(seed=case.seed) == case
    others = {case, case.choose(seed=5), case.choose(schedule="sequential"), case.with_values({"name": "other"}), greatest}
    assert len(others) == 5
    assert case != case.text and case is not None


def test_last_choice_wins(case: ballast.Case) -> None:
    chosen = case.choose(seed=5, schedule="sequential")
    assert (chosen.seed, chosen.schedule) == (5, "sequential")
    with pytest.raises(ballast.CaseError, match="expected one of"):
        case.choose(schedule="random")
    for seed in (-1, 2**70):
        with pytest.raises(ballast.RequestError, match="seed: expected 0 to 2"):
            case.choose(seed=seed)
    assert case.choose(seed=5).with_values({"bed.seed": 2}).seed == 2
    assert case.choose(seed=5).with_values({"bed": {**case.to_dict()["bed"], "seed": 2}}).seed == 2
    assert case.choose(seed=5).with_values({"run.output_interval_s": 0.0}).seed == 5
    assert case.with_values({"bed.seed": 2}).choose(seed=5).seed == 5


def test_unreadable_files_raise_file_error(tmp_path: Path, case: ballast.Case) -> None:
    with pytest.raises(ballast.FileError, match="nowhere"):
        ballast.Case.load(tmp_path / "nowhere.toml")
    with open(tmp_path / "large.toml", "wb") as large:
        large.truncate(3 << 30)
    with pytest.raises(ballast.FileError, match="large.toml: larger than 8388608 bytes"):
        ballast.Case.load(tmp_path / "large.toml")
    broken = tmp_path / "broken.h5"
    broken.write_bytes(b"no checkpoint")
    for read in (ballast.resume, ballast.read):
        with pytest.raises(ballast.FileError, match="broken.h5"):
            read(broken)
    with pytest.raises(ballast.FileError):
        ballast.read(tmp_path / "nothing.mcap")
    (tmp_path / "file").write_text("")
    with pytest.raises(ballast.FileError, match="beds cannot be written"):
        ballast.prepare(case, bed_cache=tmp_path / "file" / "beds", progress=False)


def test_prepare_reports_progress(case: ballast.Case, tmp_path: Path) -> None:
    reported: list[tuple[float, str]] = []
    path = ballast.prepare(
        case, bed_cache=tmp_path, threads=1, progress=lambda share, text: reported.append((share, text))
    )
    assert Path(path).exists()
    assert all(0.0 <= share <= 1.0 and text for share, text in reported)
    stamp = Path(path).stat().st_mtime_ns
    assert ballast.prepare(case, bed_cache=tmp_path, progress=False) == path
    assert Path(path).stat().st_mtime_ns == stamp, "it was there"


def test_damaged_beds_raise_with_a_hint(case: ballast.Case, beds: Path, tmp_path: Path) -> None:
    [bed] = beds.glob(f"{case.bed_key}.h5")
    # Damaged, and that of another case.
    for damaged, of in ((b"no bed", case), (bed.read_bytes(), case.choose(seed=5))):
        path = tmp_path / f"{of.bed_key}.h5"
        path.write_bytes(damaged)
        for use in (ballast.open, ballast.prepare):
            with pytest.raises(ballast.FileError, match=r"prepare it again with `ballast.prepare\(case, rebuild=True\)`, or delete"):
                use(of, bed_cache=tmp_path, progress=False)  # type: ignore[operator]
    ballast.prepare(case, bed_cache=tmp_path, threads=1, progress=False, rebuild=True)
    ballast.open(case, bed_cache=tmp_path, threads=1, progress=False).close()


def test_exceptions_of_the_progress_callback_end_prepare(tmp_path: Path) -> None:
    def listen(share: float, text: str) -> None:
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        ballast.prepare(ROOT / "examples/slice.toml", bed_cache=tmp_path, progress=listen)
    assert not list(tmp_path.glob("*.h5"))


def test_invalid_toml_values_are_reported_with_their_key(case: ballast.Case) -> None:
    with pytest.raises(ballast.CaseError, match="frequency_Hz"):
        case.with_values({"tamping.vibration.frequency_Hz": math.nan})
    with pytest.raises(TypeError, match="tamping.vibration.frequency_Hz: expected a string, number, .* found None"):
        case.with_values({"tamping.vibration.frequency_Hz": None})
    for no_list in ({0.3, 0.1}, frozenset([1.0]), b"text", bytearray(3)):
        with pytest.raises(TypeError, match="bed.size_m: expected a string, number, boolean, list or dictionary, found"):
            case.with_values({"bed.size_m": no_list})
    with pytest.raises(ballast.CaseError, match="seed"):
        case.with_values({"bed.seed": 2**63})
    free = case.with_values({"tamping.insertion.force_limit_N": math.inf})
    assert free.to_dict()["tamping"]["insertion"]["force_limit_N"] == math.inf


def test_inputs_accept_all_real_dtypes() -> None:
    down = np.array([[0, 0, 0], [0, 0, -1]])
    for kind in ("bool", "int8", "uint64", ">f4", "object"):
        assert repr(ballast.Motion([0, 1], down.astype(kind))) == "Motion(2 knots, 0 to 1 ns, linear)"
    assert repr(ballast.Load([0, 1], np.ma.array(down, mask=False))) == "Load(2 knots)"
    # What numpy would make numbers of.
    others = [down * 1j, down.astype("datetime64[s]"), down.astype(str).tolist()]
    hidden = [np.ma.masked_equal(down.astype(kind), -1) for kind in (float, int)]
    for rows, found in [*((rows, "no real numbers") for rows in others), *((rows, "masked numbers") for rows in hidden)]:
        for of, place in [(ballast.Motion, "positions"), (ballast.Load, "forces")]:
            with pytest.raises(ballast.RequestError, match=f"expected an array of 2 rows of 3, .* found {found}") as refused:
                of([0, 1], rows)
            assert (refused.value.code, refused.value.place) == ("input_invalid", place)


def test_rotating_hermite_motions_need_angular_velocities() -> None:
    still, turned = np.zeros((2, 3)), [[0, 0, 0, 1], [0, 0, 0.6, 0.8]]
    with pytest.raises(ballast.RequestError, match="angular_velocities: expected one per knot where orientations differ") as refused:
        ballast.Motion([0, 1], still, turned, velocities=still)
    assert (refused.value.code, refused.value.place) == ("input_invalid", "angular_velocities")
    assert repr(ballast.Motion([0, 1], still, turned)) == "Motion(2 knots, 0 to 1 ns, linear)"
    # The other sign of a quaternion is the same orientation.
    for orientations, spins in [(turned, still), ([[0, 0, 0, 1], [0, 0, 0, -1]], None)]:
        motion = ballast.Motion([0, 1], still, orientations, velocities=still, angular_velocities=spins)
        assert repr(motion) == "Motion(2 knots, 0 to 1 ns, hermite)"

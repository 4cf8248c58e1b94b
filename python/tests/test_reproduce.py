# SPDX-License-Identifier: BSD-3-Clause
"""benchmarks/reproduce.py on small stand-ins in the layouts of the published data sets."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))

import derived_datasets as derived  # noqa: E402
import published  # noqa: E402
import reproduce  # noqa: E402
from PIL import Image  # noqa: E402
from stand_ins import PROGRAM, TRUTH, rows_of, write_asl, write_tartanair  # noqa: E402


def run(tmp_path: Path, capsys: pytest.CaptureFixture[str], table: str, *words: object) -> tuple[int, str, list[dict]]:
    """Exit code, what was printed, the record's results."""
    record = tmp_path / "record.json"
    code = reproduce.main([table, "--root", str(tmp_path / "data"), "--out", str(tmp_path / "out"), "--airslam",
                           str(PROGRAM), "--json", str(record), *map(str, words)])
    content = json.loads(record.read_text())
    assert content["commit"] and content["machine"] and content["protocol"] and content["configuration"]
    return code, capsys.readouterr().out, content["results"]


def cells(text: str, name: str) -> list[str]:
    """The cells of the row that begins with a name."""
    row, = (line for line in text.splitlines() if line.startswith(f"| {name} |"))
    return [cell.strip() for cell in row.strip("|").split("|")]


def test_euroc_with_and_without_loops(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_asl(tmp_path / "data/machine_hall/MH_01_easy", 30)
    write_asl(tmp_path / "data/V1_01_easy", 20)
    code, text, results = run(tmp_path, capsys, "euroc")
    assert code == 0 and [r["name"] for r in results] == ["MH_01_easy", "V1_01_easy"]
    first, second = cells(text, "MH_01_easy"), cells(text, "V1_01_easy")
    assert first[1:3] == ["30", "100.0 %"] and float(first[3]) < 0.02 and float(first[5]) < 0.02
    assert (first[4], first[6], first[8]) == ("0.074", "0.019", "73")
    assert (second[4], second[6], second[8]) == ("0.033", "0.032", "–")
    average = cells(text, "average")
    assert average[4] == "0.053"  # the paper's mean over the sequences that were run
    assert "SE(3)" in text and re.search(r"commit [0-9a-f]{7}", text)


def test_euroc_names_what_is_missing(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    with pytest.raises(SystemExit, match="none of the sequences is in"):
        reproduce.main(["euroc", "--root", str(tmp_path / "data"), "--airslam", str(PROGRAM)])
    with pytest.raises(SystemExit, match="MH_99 is no sequence of this table"):
        reproduce.main(["euroc", "--root", str(tmp_path / "data"), "--airslam", str(PROGRAM), "--only", "MH_99"])


def test_levels_of_darkness() -> None:
    values = [derived.darkness(level) for level in range(derived.LEVELS + 1)]
    assert values[0] == (1, 1) and values[-1] == (0.22, 0.4)
    for level in range(1, derived.LEVELS + 1):
        lowered = [now < before for now, before in zip(values[level], values[level - 1])]
        assert lowered == [level % 2 == 1, level % 2 == 0]  # alternately
    ramp = np.arange(256, dtype=np.uint8)
    assert np.array_equal(derived.darken(ramp, 0), ramp)
    for level in range(1, derived.LEVELS + 1):
        assert (derived.darken(ramp, level) <= derived.darken(ramp, level - 1)).all()
    assert derived.darken(ramp, 3)[100] == round(255 * 0.74 * (100 / 255) ** (1 / 0.9))


def test_dark_euroc(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = write_asl(tmp_path / "data/V2_01_easy", 25)
    code, text, results = run(tmp_path, capsys, "dark-euroc", "--levels", 0, 12, "--keep")
    assert code == 0 and [r["name"] for r in results] == ["L0", "L12"]
    assert cells(text, "L12")[1:4] == ["0.22", "0.40", "25"]
    assert all(r["rmse"] < 0.05 and r["rmse_loops"] < 0.05 for r in results)
    assert "A and γ are our choice" in text and "0.029" in text
    image = next((source / "mav0/cam1/data").iterdir())
    for level in (0, 12):
        folder = tmp_path / f"out/level_{level:02d}/dataset"
        found = np.asarray(Image.open(folder / "mav0/cam1/data" / image.name))
        assert np.array_equal(found, derived.darken(np.asarray(Image.open(image).convert("L")), level))
        assert (folder / TRUTH).read_bytes() == (source / TRUTH).read_bytes()
        assert (folder / "mav0/imu0/data.csv").exists() and (folder / "mav0/cam0/sensor.yaml").exists()


def test_dark_euroc_calls_a_metre_a_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = write_asl(tmp_path / "data/V2_01_easy", 20)
    head, rows = rows_of(source / TRUTH)
    fields = [row.split(",") for row in rows]  # a path ten times as long as that of the images
    scaled = [",".join([f[0], *(str(10 * float(v)) for v in f[1:4]), *f[4:]]) for f in fields]
    (source / TRUTH).write_text("\n".join([head, *scaled]) + "\n")
    code, text, results = run(tmp_path, capsys, "dark-euroc", "--levels", 0)
    assert code == 1 and results[0]["rmse"] > 1 and results[0]["failure"].startswith("RMSE ")
    assert "F (RMSE" in cells(text, "L0")[5]
    assert not (tmp_path / "out/level_00/dataset").exists()  # without --keep


def test_oivio(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "data/MN_015_GV_01/husky0"
    write_asl(folder, 25, truth="groundtruth.csv")
    code, text, _ = run(tmp_path, capsys, "oivio")
    row = cells(text, "MN_015_GV_01")
    assert code == 0 and row[1:3] == ["25", "100.0 %"] and float(row[3]) < 0.02 and row[4] == "0.054"
    assert "no loop closing" in text and "lost for more than 10 s" in text


def test_uma_vi_with_truth_at_start_and_end_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_asl(tmp_path / "data/conference-csc2", 40)
    head, rows = rows_of(folder / TRUTH)
    (folder / TRUTH).write_text("\n".join([head, *rows[:200], *rows[-200:]]) + "\n")
    code, text, results = run(tmp_path, capsys, "uma-vi", "--", "--no-lines")
    row = cells(text, "conference-csc2")
    assert code == 0 and float(row[3]) < 0.02 and row[4] == "0.091" and row[2] == "100.0 %"
    assert "start and end only" in text and "--no-lines" in text and results[0]["rmse_loops"] is None


def test_a_long_loss_is_a_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = write_asl(tmp_path / "data/long-walk-eng", 20)
    for camera in ("cam0", "cam1"):  # the same frames 1 s apart, and darkness for 12 s in the middle
        csv = folder / "mav0" / camera / "data.csv"
        head, rows = rows_of(csv)
        names = [row.split(",")[1] for row in rows]
        black = folder / "mav0" / camera / "data/black.png"
        Image.fromarray(np.zeros((480, 752), np.uint8)).save(black)
        start = int(rows[0].split(",")[0])
        listed = names[:4] + [black.name] * 13 + names[4:8]
        csv.write_text("\n".join([head, *(f"{start + i * 10**9},{n}" for i, n in enumerate(listed))]) + "\n")
    _, truth_rows = rows_of(folder / TRUTH)
    fields = truth_rows[0].split(",")[1:]
    (folder / TRUTH).write_text("#\n" + "\n".join(
        ",".join([str(start + i * 10**9), f"{0.1 * i}", f"{0.01 * i * i}", *fields[2:]]) for i in range(21)) + "\n")
    code, text, results = run(tmp_path, capsys, "uma-vi", "--", "--no-imu")
    assert code == 1 and results[0]["longest_gap"] > 10
    assert re.match(r"F \(lost for 1\d\.\d s\)", cells(text, "long-walk-eng")[3])


def test_tartanair_by_day_and_night(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    day = tmp_path / "data/abandonedfactory/abandonedfactory/Easy/P000"
    night = tmp_path / "data/abandonedfactory_night/abandonedfactory_night/Easy/P005"
    write_tartanair(day, list(range(0, 50, 2)))
    write_tartanair(night, [5, 15, 25, 35, 139], darken=1.6)  # the last is far from every map image
    code, text, results = run(tmp_path, capsys, "tartanair-daynight")
    row = cells(text, "P000")
    assert code == 0 and row[1:3] == ["25", "4"]
    assert results[0]["recall"] == 100 and results[0]["wrong"] == 0
    assert row[4] == "89.5" and "within 2 m and 15°" in text


def test_tartanair_folders_are_checked(tmp_path: Path) -> None:
    day = tmp_path / "data/abandoned_factory/P000"
    write_tartanair(day, [0, 1])
    with pytest.raises(SystemExit, match="no night sequence"):
        reproduce.main(["tartanair-daynight", "--root", str(tmp_path / "data"), "--airslam", str(PROGRAM)])
    (day / "pose_left.txt").write_text("0 0 0 0 0 0 1\n")
    with pytest.raises(SystemExit, match="2 left and 2 right images and 1 poses"):
        derived.read_tartanair(day)


def test_near_by_distance_and_angle() -> None:
    def sequence(positions: list, quaternions: list) -> derived.TartanSequence:
        return derived.TartanSequence(Path(), [], [], np.array(positions, float), np.array(quaternions, float))

    def turned(degrees: float) -> list[float]:
        half = np.radians(degrees) / 2
        return [0, 0, np.sin(half), np.cos(half)]

    day = sequence([[0, 0, 0], [10, 0, 0]], [turned(0), turned(90)])
    others = [([2.9, 0, 0], turned(14)), ([3.1, 0, 0], turned(0)), ([0, 0, 0], turned(16)),
              ([10, 1, 0], [-v for v in turned(80)]), ([0, 0, 0], turned(90))]
    night = sequence([p for p, _ in others], [q for _, q in others])
    assert derived.near(day, night, 3, 15).tolist() == [0, 3]


def test_the_papers_numbers_are_those_of_its_tables() -> None:
    assert len(published.EUROC) == 11 and len(published.OIVIO) == 9 and len(published.UMA_VI) == 10
    means = [np.mean([pair[i] for pair in published.EUROC.values()]) for i in (0, 1)]
    # The paper's own averages: 0.113 and 0.030 (EuRoC), 0.058 (OIVIO), 0.441 (UMA-VI), 80.5 % (TartanAir).
    assert means == pytest.approx([0.113, 0.030], abs=0.0015)
    assert np.mean(list(published.OIVIO.values())) == pytest.approx(0.058, abs=0.0006)
    assert np.mean(list(published.UMA_VI.values())) == pytest.approx(0.441, abs=0.0006)
    assert np.mean(list(published.TARTANAIR_RECALL.values())) == pytest.approx(80.5, abs=0.06)

"""Noise parameters are recovered from recordings with noise, and rendering and runs accept the file."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from gensim2.cli import main as cli
from gensim2.core.errors import InputError
from gensim2.perception import D435, DepthNoise
from gensim2.perception.camera_record import CameraRecord
from gensim2.perception.noise import NoiseFile, read_noise
from gensim2.robots import robot
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.fit_noise import StillRecording, fit
from gensim2_robot.log import Log
from gensim2_robot.log_messages import About
from gensim2_robot.simulated import simulated_cameras

FOCAL = 210.0
ROWS, COLUMNS = np.mgrid[0:120, 0:160].astype(np.float64)
COLORS = np.full((120, 160, 3), 180, np.uint8)
COLORS[90:] = 10


def scene() -> np.ndarray:
    """Return a slope with tilted blocks on it and a wall that faces the camera."""
    depth = 0.9 + 0.002 * COLUMNS + 0.001 * ROWS
    for left in (15, 60, 105):
        for top in (10, 50):
            block = np.s_[top : top + 26, left : left + 26]
            depth[block] = 0.55 + 0.002 * (COLUMNS[block] - left)
    depth[:, 142:] = 0.5
    return depth.astype(np.float32)


def recorded(noise: DepthNoise, count: int = 30) -> StillRecording:
    draw = np.random.default_rng(1)
    depths = np.stack([noise.on(scene(), draw, COLORS, FOCAL) for _ in range(count)])
    return StillRecording((np.rint(1e3 * depths) / 1e3).astype(np.float32), COLORS, FOCAL)


STILL = replace(D435, spread=0.0)


@pytest.mark.parametrize(
    "noise",
    [
        replace(STILL, disparity_sigma=0.12, correlation=1.5, dark_lost=0.4, edge_lost=0.2, lost=0.01),
        replace(STILL, disparity_sigma=0.05, correlation=0.0, shadow=False, dark_lost=0.1, lost=0.03, fattening=0.0),
        replace(STILL, specular_lost=0.4, edge_lost=0.35, edge_mixed=0.15, fattening=0.0),
    ],
)
def test_parameters_come_back(noise: DepthNoise) -> None:
    found, told = fit([recorded(noise)], D435)
    assert found.disparity_sigma == pytest.approx(noise.disparity_sigma, rel=0.1)
    assert found.correlation == pytest.approx(noise.correlation, abs=0.15)
    assert found.lost == pytest.approx(noise.lost, abs=0.01)
    assert found.dark_lost == pytest.approx(noise.dark_lost, abs=0.05)
    assert found.specular_lost == pytest.approx(noise.specular_lost, abs=0.08)
    assert found.shadow is noise.shadow
    if not noise.fattening:  # fattening moves the edges
        assert found.edge_lost == pytest.approx(noise.edge_lost, abs=0.08)
        assert found.edge_mixed == pytest.approx(noise.edge_mixed, abs=0.08)
    assert {"disparity_sigma", "correlation", "lost", "edge_lost", "dark_lost", "shadow"} <= set(told)


def test_too_few_pictures_are_refused() -> None:
    with pytest.raises(InputError, match="at least 8 images"):
        fit([recorded(STILL, 4)])


def test_a_log_becomes_a_file_that_others_take(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    camera = next(each for each in simulated_cameras(robot("panda"), 160, 120) if each.name == "left")
    noise = replace(STILL, disparity_sigma=0.15)
    about = About(robot="panda", language="shut", observation={"cameras": ["left"]}, cameras=[CameraRecord.of(camera)])
    log = Log(tmp_path / "log", about)
    for number in range(300):
        log.state(ArmState(0.01 * number, np.zeros(9), np.zeros(9), 0.0))
    depths = recorded(noise, 20).depths
    for number, depth in enumerate(depths):
        log.frame(CameraFrame("left", number, 0.4 + 0.1 * number, (1e3 * depth + 0.5).astype(np.uint16), COLORS, "x"))
    log.close()
    file, out = tmp_path / "noise.json", tmp_path / "out.json"
    assert cli.run(["robot", "fit-noise", str(tmp_path / "log"), "--out", str(file), "--json", str(out)]) == 0
    assert json.loads(out.read_text())["recordings"] == 1
    assert read_noise(file).disparity_sigma == pytest.approx(0.15, rel=0.1)
    assert read_noise("d435") == D435
    capfd.readouterr()
    assert cli.run(["robot", "fit-noise", str(tmp_path)]) == 2
    assert "contains no log" in capfd.readouterr().err


@pytest.mark.parametrize(("change", "said"), [({"lost": 2.0}, "must add up to at most 1"), ({"fuzz": 1.0}, "fuzz")])
def test_a_file_that_is_no_noise_is_refused(tmp_path: Path, change: dict[str, float], said: str) -> None:
    path = tmp_path / "noise.json"
    path.write_text(NoiseFile(noise={**asdict(D435), **change}, told={}).model_dump_json())
    with pytest.raises(InputError, match=said):
        read_noise(path)

"""Camera calibration by the robot's meshes and by a board: accuracy checks and errors."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import cv2
import numpy as np
import pytest
import robot_calibration as benchmark
from scipy.spatial.transform import Rotation

from gensim2.cli import main as cli
from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.perception import D435, Camera
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.robots import robot
from gensim2_robot.calibration.board import Board, Corners, find_corners, hand_eye
from gensim2_robot.calibration.file import Calibration, calibrated, read_calibration
from gensim2_robot.calibration.mesh import calibrate
from gensim2_robot.calibration.run import displaced
from gensim2_robot.calibration.surfaces import ArmView
from gensim2_robot.simulated import simulated_cameras

PROFILE = robot("panda")
CAMERAS = [camera for camera in simulated_cameras(PROFILE, 160, 120) if camera.link is None]
BOARD = Board(7, 5, 0.04, 0.03)


@pytest.fixture(scope="module")
def views() -> list[ArmView]:
    """Images of the left camera."""
    draw = rng(5, "calibration test")
    scene = RaycastScene(PROFILE, {}, [CAMERAS[0]])
    return [benchmark.picture(scene, q, D435, 1.005, 0.002, draw) for q in benchmark.arm_poses(draw, 5)]


@pytest.mark.parametrize("number", [0, 1])
def test_a_camera_is_found_from_far_off(number: int) -> None:
    found = benchmark.calibrated(number, 5, 15.0, 0.1, (160, 120), 0)
    assert found["trouble"] is None
    assert found["mm"] < 3.0
    assert found["deg"] < 0.2
    assert abs(found["scale"]) < 0.005


def test_what_cannot_be_told_is_said(views: list[ArmView]) -> None:
    guess = displaced(CAMERAS[0], 10.0, 0.05, rng(0, "guess"))
    surface = benchmark.surface()
    still = calibrate(surface, guess, [views[0]] * 4, views[4:])
    assert "does not move" in str(still.trouble)
    lying = [ArmView(view.q + 0.15, view.depth) for view in views[3:]]  # joints that differ from the fitted ones
    assert calibrate(surface, guess, views[:3], lying).trouble is not None
    lost = replace(guess, T_base_camera=guess.T_base_camera @ np.diag([-1.0, 1.0, -1.0, 1.0]))  # looks backwards
    assert calibrate(surface, lost, views[:4], views[4:]).trouble is not None


def test_what_cannot_be_fitted_to_is_refused(views: list[ArmView]) -> None:
    surface = benchmark.surface()
    with pytest.raises(InputError, match="3 to 9"):
        calibrate(surface, CAMERAS[0], views[:2], views[4:])
    with pytest.raises(InputError, match=r"left\.depth"):
        calibrate(surface, replace(CAMERAS[0], width=80), views[:3], views[4:])
    with pytest.raises(InputError, match="with a board"):
        calibrate(surface, replace(CAMERAS[0], link="panda_hand"), views[:3], views[4:])


# --- board


def pose(draw: np.random.Generator, spread: float, at: tuple[float, float, float]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(draw.normal(0.0, spread, 3)).as_matrix()
    T[:3, 3] = at + draw.normal(0.0, 0.05, 3)
    return T


@pytest.mark.parametrize("carried", [True, False])
def test_hand_and_eye_are_told_by_noisy_corners(carried: bool) -> None:
    draw = rng(3, "hand eye")
    camera = CAMERAS[0]
    X = pose(draw, 0.5, (0.05, 0.0, 0.06))
    views = []
    points = np.array([[0.04 * x, 0.04 * y, 0.0] for x in range(1, 7) for y in range(1, 5)])
    Z = pose(draw, 0.5, (0.5, 0.0, 0.0))
    for _ in range(12):
        T_camera_board = pose(draw, 0.3, (-0.1, -0.1, 0.6))
        A = Z @ np.linalg.inv(T_camera_board) @ np.linalg.inv(X)
        seen = (points @ T_camera_board[:3, :3].T + T_camera_board[:3, 3]) @ camera.intrinsic.T
        pixels = seen[:, :2] / seen[:, 2:] + draw.normal(0.0, 0.2, (len(points), 2))
        views.append(Corners(A if carried else np.linalg.inv(A), points, pixels))
    found = hand_eye(camera, views[:9], views[9:], carried=carried)
    error = np.linalg.inv(X) @ found.camera
    assert np.linalg.norm(error[:3, 3]) < 0.004
    assert np.rad2deg(Rotation.from_matrix(error[:3, :3]).magnitude()) < 0.4
    assert found.held_out_px < 0.5
    with pytest.raises(InputError, match="two axes"):
        hand_eye(camera, [replace(view, T_base_hand=np.eye(4)) for view in views[:1] * 5], views[9:], carried=carried)


def test_corners_of_a_picture_lie_where_the_board_is() -> None:
    drawn = BOARD.charuco().generateImage((700, 500))  # 100 pixels per square
    camera = Camera("a", 640, 480, np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]), np.eye(4))
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix()
    T[:3, 3] = [-0.12, -0.1, 0.5]
    corners = np.array([[0, 0, 0], [0.28, 0, 0], [0.28, 0.2, 0], [0, 0.2, 0]])
    seen = (corners @ T[:3, :3].T + T[:3, 3]) @ camera.intrinsic.T
    there = (seen[:, :2] / seen[:, 2:]).astype(np.float32) - 0.5  # in OpenCV the first pixel's centre is at 0
    here = np.array([[0, 0], [700, 0], [700, 500], [0, 500]], dtype=np.float32) - 0.5
    picture = cv2.warpPerspective(drawn, cv2.getPerspectiveTransform(here, there), (640, 480), borderValue=128)
    found = find_corners(np.repeat(picture[:, :, None], 3, axis=2), BOARD, np.eye(4))
    assert found is not None
    assert len(found.points) > 15
    where = (found.points @ T[:3, :3].T + T[:3, 3]) @ camera.intrinsic.T
    assert np.abs(where[:, :2] / where[:, 2:] - found.pixels).max() < 0.5
    assert find_corners(np.zeros((480, 640, 3), np.uint8), BOARD, np.eye(4)) is None


@pytest.mark.parametrize("text", ["7x5", "7:0.04:0.03", "7x5:0.03:0.04", "2x2:0.04:0.03"])
def test_words_that_are_no_board_are_refused(text: str) -> None:
    with pytest.raises(InputError, match="board"):
        Board.parse(text)


# --- file


def test_a_calibration_from_poses_to_a_run(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The arm is moved within the limits, the file is written, and a run uses it."""
    file, out = tmp_path / "calibration.json", tmp_path / "out.json"
    small = ["--pixels", "160x120", "--assets", "builtin", "--json", str(out)]
    words = ["--poses", "5", "--speed", "1.0", "--degrees", "8", "--metres", "0.05", "--out", str(file)]
    assert cli.run(["robot", "calibrate", "CloseBox", *small, *words]) == 0, capfd.readouterr().out
    found = json.loads(out.read_text())
    assert found["converged"]
    for camera in found["cameras"].values():
        assert camera["error_mm"] < 5.0
        assert camera["held_out_mm"] < 6.0
        assert camera["links_mm"]
    run = ["robot", "run", "CloseBox", "--plan", "--simulated-clock", "--minutes", "0.02", "--no-log"]
    assert cli.run([*run, *small, "--calibration", str(file)]) == 0, capfd.readouterr().out
    old = json.loads(file.read_text())
    old["made"] = (datetime.now(UTC) - timedelta(days=8)).isoformat()
    file.write_text(json.dumps(old))
    capfd.readouterr()
    assert cli.run([*run, *small, "--calibration", str(file)]) == 2
    assert "is stale: 8.0 days old" in capfd.readouterr().err
    pose = old["cameras"]["left"]["pose"]
    old |= {"made": datetime.now(UTC).isoformat()}
    old["cameras"]["left"]["pose"] = [[each[1], each[0], each[2], each[3]] for each in pose]
    file.write_text(json.dumps(old))
    assert cli.run([*run, *small, "--calibration", str(file)]) == 2
    assert "mirroring" in capfd.readouterr().err


def written(path: Path) -> Calibration:
    camera = {
        "serial": "123",
        "method": "mesh",
        "link": None,
        "pose": np.eye(4).tolist(),
        "width": 160,
        "height": 120,
        "intrinsic": np.eye(3).tolist(),
        "scale": 1.01,
        "bias": -0.002,
        "residual_mm": 1.0,
        "held_out_mm": 1.0,
    }
    found = Calibration.model_validate({"made": datetime.now(UTC), "robot": "panda", "cameras": {"left": camera}})
    found.write(path)
    return found


def test_what_a_calibration_says_holds_for_depth_and_pose(tmp_path: Path) -> None:
    path = tmp_path / "c.json"
    written(path)
    found = read_calibration(path, "panda", CAMERAS[:1])
    (camera,) = calibrated(CAMERAS[:1], found)
    np.testing.assert_array_equal(camera.T_base_camera, np.eye(4))
    np.testing.assert_allclose(camera.metres(np.array([[0, 1000]], np.uint16)), [[0.0, 1.008]], atol=1e-6)


@pytest.mark.parametrize(
    ("robot_name", "cameras", "days", "ahead", "said"),
    [
        ("fetch", CAMERAS[:1], 7.0, 0.0, "is for the robot panda"),
        ("panda", CAMERAS[:2], 7.0, 0.0, "cameras.right: is not calibrated"),
        ("panda", [replace(CAMERAS[0], width=320)], 7.0, 0.0, "160x120"),
        (
            "panda",
            [replace(CAMERAS[0], link="panda_hand")],
            7.0,
            0.0,
            "calibrated on a fixed mount, but is now on panda_hand",
        ),
        ("panda", CAMERAS[:1], 1.0, 2.0, "is stale: 2.0 days"),
        ("panda", CAMERAS[:1], 1.0, -2.0, "future"),
    ],
)
def test_a_calibration_of_something_else_is_refused(
    tmp_path: Path, robot_name: str, cameras: list[Camera], days: float, ahead: float, said: str
) -> None:
    path = tmp_path / "c.json"
    now = written(path).made + timedelta(days=ahead)
    with pytest.raises(InputError, match=said):
        read_calibration(path, robot_name, cameras, days=days, now=now)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"intrinsic": [[200.0, 0.0, 80.0], [0.0, 200.0], [0.0, 0.0, 1.0]]}, "inhomogeneous"),
        ({"intrinsic": [[200.0, 0.0, 80.0], [0.0, 200.0, 60.0]]}, "intrinsic"),
        ({"intrinsic": [[-200.0, 0.0, 80.0], [0.0, 200.0, 60.0], [0.0, 0.0, 1.0]]}, "intrinsic.*fx and fy"),
        ({"intrinsic": [[0.0, 0.0, 80.0], [0.0, 200.0, 60.0], [0.0, 0.0, 1.0]]}, "intrinsic.*fx and fy"),
        ({"intrinsic": [[1e-320, 0.0, 80.0], [0.0, 200.0, 60.0], [0.0, 0.0, 1.0]]}, "intrinsic.*fx and fy"),
        ({"intrinsic": [[1e9, 0.0, 80.0], [0.0, 200.0, 60.0], [0.0, 0.0, 1.0]]}, "intrinsic.*none over"),
        ({"intrinsic": [[200.0, 0.0, 80.0], [0.0, 200.0, 60.0], [0.0, 1.0, 1.0]]}, "intrinsic"),
        ({"pose": [[1.0, 0.0, 0.0, 1e9], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]}, "100 m"),
        ({"pose": [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]}, "pose"),
        ({"pose": [[1.0], []]}, "inhomogeneous"),
        ({"pose": (2.0 * np.eye(4)).tolist()}, "last row"),
        ({"width": 10**7}, "8192 pixels"),
        ({"height": 0}, "8192 pixels"),
        ({"links_mm": {"hand": "x"}}, "links_mm"),
        ({"scale": 10**400}, "scale"),
    ],
)
def test_a_calibration_of_no_camera_is_refused_by_field(tmp_path: Path, change: dict[str, object], said: str) -> None:
    path = tmp_path / "c.json"
    plain = json.loads(written(path).model_dump_json())
    plain["cameras"]["left"] |= change
    path.write_text(json.dumps(plain))
    with pytest.raises(InputError, match=f"cameras.left.*{said}"):
        read_calibration(path, "panda", CAMERAS[:1])
    for made in ("0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59-14:00", "2026-01-01T00:00:00"):
        path.write_text(json.dumps({**json.loads(written(path).model_dump_json()), "made": made}))
        with pytest.raises(InputError, match="made"):
            read_calibration(path, "panda", CAMERAS[:1])

"""A log becomes a film, a picture of three moments, and a file that Foxglove opens with the layout beside it."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pytest
from mcap.reader import make_reader

from gensim2.core.errors import InputError
from gensim2.perception import ObservationSpec
from gensim2.perception.camera_record import CameraRecord
from gensim2.robots import robot
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.export import FILM, FOXGLOVE, LAYOUT, STILL, export
from gensim2_robot.log import Log
from gensim2_robot.log_messages import About
from gensim2_robot.mind import ControllerAnswer
from gensim2_robot.simulated import simulated_cameras

NAMES = ("left", "right", "front")
SECONDS = 2.0
PANDA = robot("panda")


def _log(
    folder: Path,
    *,
    pictures: bool = True,
    ends: bool = False,
    moves: Sequence[int] = (),
    episodes: Sequence[int] = (),
) -> Path:
    """A log of two seconds: cameras whose pictures become brighter, one cloud, and an arm that moves from some pictures
    to the next ones and otherwise rests. At the pictures ``episodes`` an episode starts and ends by turns; without them
    an episode lasts from the first picture on.
    """
    (first, *_) = simulated_cameras(PANDA, 320, 240)
    cameras = [CameraRecord.of(replace(first, name=name)) for name in NAMES]
    spec = ObservationSpec(cameras=NAMES).to_dict()
    log = Log(folder, About(robot="panda", language="close it", observation=spec, cameras=cameras, task="CloseBox"))
    joints = np.array(PANDA.reset_qpos)
    cloud = np.tile(np.float32([0.4, 0.1, 0.2, 1.0, 0.5, 0.0]), (3, 1))
    log.answer(0.0, ControllerAnswer(1, np.zeros((1, 8), np.float32), seen={"point_cloud": cloud}))
    for number in range(round(10 * SECONDS) + 1):
        time = 0.1 * number
        if not episodes:
            log.change(time, "running", f"step {number}")
        elif number in episodes:
            starts = episodes.index(number) % 2 == 0
            log.change(time, *(("running", "episode started") if starts else ("idle", "episode over")))
        log.state(ArmState(time, joints + 0.1 * sum(each < number for each in moves), np.zeros(9), 1.5))
        for name in NAMES if pictures else ():
            colors = np.full((240, 320, 3), 10 * number, np.uint8)
            log.frame(CameraFrame(name, number, time, np.zeros((240, 320), np.uint16), colors))
    if ends:
        log.change(SECONDS + 0.01, "idle", "episode over")
    log.close()
    assert log.trouble is None
    return folder


def test_the_film_shows_all_cameras_and_the_still_three_moments(tmp_path: Path) -> None:
    found = export(_log(tmp_path / "log"), tmp_path / "out")
    assert found["seconds"] == SECONDS
    assert found["frames"] == 21
    film = imageio.get_reader(tmp_path / "out" / FILM)
    assert film.count_frames() == 21
    assert film.get_meta_data()["size"] == (960, 288)
    still = imageio.imread(tmp_path / "out" / STILL)
    assert still.shape == (3 * 288, 960, 3)
    middles = [int(still[288 * row + 150, 480, 0]) for row in range(3)]
    assert middles == [40, 100, 170]


def test_the_still_shows_moments_in_which_the_arm_acts(tmp_path: Path) -> None:
    export(_log(tmp_path / "log", moves=(13, 14, 15)), tmp_path / "out")
    still = imageio.imread(tmp_path / "out" / STILL)
    assert [int(still[288 * row + 150, 480, 0]) for row in range(3)] == [140, 150, 160]


def test_the_still_shows_one_episode(tmp_path: Path) -> None:
    """The arm moves in both episodes, and most in the second one."""
    export(_log(tmp_path / "log", moves=(2, 3, 4, 8, 12, 13, 14, 15, 16), episodes=(1, 7, 10)), tmp_path / "out")
    still = imageio.imread(tmp_path / "out" / STILL)
    assert [int(still[288 * row + 150, 480, 0]) for row in range(3)] == [30, 40, 50]


def test_the_last_picture_of_the_film_names_the_state_at_the_end(tmp_path: Path) -> None:
    films = []
    for ends in (False, True):
        export(_log(tmp_path / f"log{ends}", ends=ends), tmp_path / f"out{ends}")
        films.append(np.array(imageio.mimread(tmp_path / f"out{ends}" / FILM, memtest=False), int)[:, -24:])
    changed = np.abs(films[0] - films[1]).max(axis=(1, 2, 3)) > 100
    assert changed.tolist() == [False] * 20 + [True]


def test_foxglove_finds_what_the_layout_shows(tmp_path: Path) -> None:
    export(_log(tmp_path / "log"), tmp_path / "out")
    with (tmp_path / "out" / FOXGLOVE).open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        schemas = {each.topic: summary.schemas[each.schema_id] for each in summary.channels.values()}
        messages = {channel.topic: json.loads(each.data) for _, channel, each in reader.iter_messages()}
    layout = (tmp_path / "out" / LAYOUT).read_text()
    assert json.loads(layout)["layout"]
    topics = set(re.findall(r'"(/[\w/]+)', layout)) - {"/clocks"}  # without a period there are none
    assert topics <= schemas.keys()
    for topic, path in (("/arm", "q"), ("/arm", "force"), ("/watch", "state")):
        assert path in messages[topic]
    assert schemas["/camera/left"].name == "foxglove.CompressedImage"
    assert json.loads(schemas["/camera/left"].data)["properties"]["data"]["contentEncoding"] == "base64"
    assert imageio.imread(base64.b64decode(messages["/camera/left"]["data"])).shape == (240, 320, 3)
    cloud = messages["/cloud"]
    packed = np.frombuffer(base64.b64decode(cloud["data"]), dtype=[("xyz", "<f4", 3), ("rgba", "u1", 4)])
    assert packed["xyz"][0].tolist() == pytest.approx([0.4, 0.1, 0.2])
    assert packed["rgba"][0].tolist() == [255, 127, 0, 255]
    assert cloud["point_stride"] == packed.itemsize
    hand = PANDA.model.forward_kinematics(np.array(PANDA.reset_qpos), "panda_hand")[:3, 3]
    (placed,) = (each for each in messages["/tf"]["transforms"] if each["child_frame_id"] == "panda_hand")
    assert list(placed["translation"].values()) == pytest.approx(hand.tolist(), abs=1e-5)
    assert {each["frame_id"] for each in messages["/robot"]["entities"]} >= {"panda_link0", "panda_hand"}


def test_a_log_without_pictures_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the log has no pictures"):
        export(_log(tmp_path / "log", pictures=False), tmp_path / "out")

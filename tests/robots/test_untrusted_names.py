"""A name in a file never loads code or other files, in any kind of file."""

from __future__ import annotations

import copy
import json
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("mani_skill")

import gensim2
from gensim2.cli.main import run
from gensim2.core.errors import GenSim2Error, InputError
from gensim2.data import video
from gensim2.data.record import DatasetRecord
from gensim2.data.video import Replay
from gensim2.perception import ObservationSpec
from gensim2.policy.checkpoint import PolicyCheckpoint, checkpoint_folder
from gensim2.policy.sentences import sentence_row
from gensim2.policy.starting import check_text
from gensim2.robots import robot
from gensim2.scenes.config import SceneOptions
from gensim2.tasks.library import load_task
from gensim2_robot.log import Log
from gensim2_robot.log_messages import About

CANARY = """
from pathlib import Path
Path(__file__).with_name("ran").touch()
import gensim2

@gensim2.register_robot
def canary():
    return gensim2.robot("panda")
"""
SPELLINGS = ("canary.py", "./canary.py:canary", "{folder}/canary.py", "{folder}/canary.py:canary", "canary:canary")


@pytest.fixture
def trap(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder, also on the path, with a module that leaves a file when it is imported."""
    (tmp_path / "canary.py").write_text(CANARY)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def checkpoint(folder: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Return a copy of the package's policy with another ``config.json``."""
    shutil.copytree(checkpoint_folder("builtin"), folder / "box")
    file = folder / "box" / "config.json"
    config = json.loads(file.read_text())
    change(config)
    file.write_text(json.dumps(config))
    return folder / "box"


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str], trap: Path) -> str:
    """Return the error message of a command."""
    assert run(arguments) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1, said
    assert not (trap / "ran").exists()
    return said


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_no_spelling_of_a_name_loads_anything(spelling: str, trap: Path) -> None:
    name = spelling.format(folder=trap)
    for use in (
        robot,
        lambda each: SceneOptions("builtin", robot=each),
        lambda each: gensim2.HeadlessEnv("OpenDrawer", assets="builtin", robot=each),
        lambda each: gensim2.make_env("OpenDrawer", assets="builtin", robot=each),
    ):
        with pytest.raises(InputError, match="not loaded") as caught:
            use(name)
        assert caught.value.remedy is not None
        assert "canary" not in caught.value.remedy
    assert not (trap / "ran").exists()


def test_a_robot_that_was_loaded_is_known_to_files_and_to_workers(trap: Path) -> None:
    place = gensim2.load_robot("canary.py")
    assert (trap / "ran").exists()
    read = json.loads(json.dumps(place))
    assert robot(read) is robot("canary")
    for sent in (pickle.loads(pickle.dumps(SceneOptions("builtin", robot=read))), copy.deepcopy(place)):
        assert pickle.dumps(sent).count(b"_granted") == 1, "whoever receives it may load it"


@pytest.mark.parametrize(
    "command",
    [
        ["policy", "serve", "box"],
        ["bench", "policy", "--checkpoint", "box"],
        ["evaluate", "OpenDrawer", "--checkpoint", "box"],
        ["robot", "run", "OpenDrawer", "--policy", "box", "--minutes", "0.1", "--no-log"],
    ],
    ids=lambda words: words[0],
)
def test_the_robot_of_a_checkpoint_is_not_loaded(
    command: list[str], trap: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checkpoint(trap, lambda config: config.update(robot="box/canary.py"))
    shutil.copy(trap / "canary.py", trap / "box" / "canary.py")
    said = refused(command, capsys, trap)
    assert not (trap / "box" / "ran").exists()
    assert "'box/canary.py' is not loaded" in said
    assert said.count("canary") == 1, "no advice to run it"


@pytest.mark.parametrize(
    "command",
    [["robot", "replay", "log"], ["robot", "calibrate", "--from", "log", "--out", "c.json"]],
    ids=lambda w: w[1],
)
def test_the_robot_of_a_log_is_not_loaded(
    command: list[str], trap: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gensim2_robot.calibration.run.read_standing", lambda _: [])  # without poses
    about = About(
        task="CloseBox",
        language="",
        robot="canary.py",
        controller={},
        arm="simulated",
        speed=1.0,
        margin=0.0,
        seed=0,
        pixels=1,
        observation=ObservationSpec().to_dict(),
        cameras=[],
    )
    Log(trap / "log", about).close()
    assert "'canary.py' is not loaded" in refused(command, capsys, trap)


def test_the_robot_and_the_physics_of_a_data_set_are_words(trap: Path) -> None:
    (trap / "soft.yaml").write_text("base: original\n")
    record = {
        "arguments": {"assets": "builtin"},
        "seed": 0,
        "episodes": 1,
        "keep_failures": False,
        "tasks": {},
        "listings": {},
        "versions": {},
    }
    DatasetRecord.model_validate(record)
    for field, value in (("robot", "canary.py"), ("physics", "soft.yaml"), ("physics", "/dev/zero.yaml")):
        with pytest.raises(ValueError, match=field):
            DatasetRecord.model_validate({**record, "arguments": {"assets": "builtin", field: value}})
    assert SceneOptions.of(assets="builtin", physics="soft.yaml").physics == "original"
    assert not (trap / "ran").exists()


def trajectory(folder: Path) -> dict[str, Any]:
    """Write a trajectory's arrays of two actions, and return its document."""
    import h5py
    import numpy as np

    with h5py.File(folder / "trajectory.h5", "w") as file:
        file["traj_0/actions"] = np.zeros((2, 8), np.float32)
    return {
        "env_info": {
            "env_id": "canary:Canary-v0",
            "env_kwargs": {"assets": "builtin", "instances": {"drawer": ["0"]}},
        },
        "gensim2": {"task": load_task("OpenDrawer").model_dump(mode="json")},
        "episodes": [{"episode_id": 0, "reset_kwargs": {"seed": 0, "options": {}}}],
    }


def test_a_stored_trajectory_names_no_environment(trap: Path) -> None:
    document = trajectory(trap)
    kwargs = document["env_info"]["env_kwargs"]
    (trap / "trajectory.json").write_text(json.dumps(document))
    assert Replay.stored(trap / "trajectory.h5").env_id == "gensim2.sim:GenSim2-OpenDrawer-v1"
    document["env_info"]["env_kwargs"] = {**kwargs, "robot": "canary.py"}
    (trap / "trajectory.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="not loaded"):
        Replay.stored(trap / "trajectory.h5")
    assert not (trap / "ran").exists()


@pytest.mark.parametrize("value", [[], 5, {}, None])
@pytest.mark.parametrize("field", ["robot", "randomization", "physics", "engine"])
def test_a_name_in_a_stored_trajectory_that_is_no_text_is_one_error(trap: Path, field: str, value: Any) -> None:
    document = trajectory(trap)
    document["env_info"]["env_kwargs"][field] = value
    (trap / "trajectory.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=field):
        Replay.stored(trap / "trajectory.h5")
    if field == "robot":
        with pytest.raises(InputError, match="no robot"):
            robot(value)


@pytest.mark.parametrize(
    "reset",
    [
        {"seed": 0, "options": {}, "kept": 1},
        {"seed": [], "options": {}},
        {"seed": 0},
        {"seed": 0, "options": {"reset_to_env_states": {"env_states": []}}},
        {"seed": 0, "options": {"openness": 10**400}},
        {"seed": 0, "options": {"offset": [10**400, 0, 0]}},
        {"seed": 0, "options": {"instance": {"shelf": "0"}}},
        {"seed": 0, "options": {"instance": [["0"]]}},
    ],
)
def test_a_reset_of_a_stored_trajectory_is_a_seed_and_options_of_ours(trap: Path, reset: dict[str, Any]) -> None:
    document = trajectory(trap)
    document["episodes"][0]["reset_kwargs"] = reset
    (trap / "trajectory.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"reset_kwargs|reset_to_env_states"):
        Replay.stored(trap / "trajectory.h5")


@pytest.mark.parametrize("options", [{}, {"instance": {}}, {"instance": "no"}])
def test_a_stored_trajectory_that_names_no_object_is_one_error(trap: Path, options: dict[str, Any]) -> None:
    """A film of recorded states needs the objects."""
    import h5py
    import numpy as np

    document = trajectory(trap)
    document["env_info"]["env_kwargs"]["engine"] = "mujoco"
    document["episodes"][0]["reset_kwargs"]["options"] = options
    (trap / "trajectory.json").write_text(json.dumps(document))
    with h5py.File(trap / "trajectory.h5", "a") as file:
        file["traj_0/env_states/articulations/panda"] = np.zeros((3, 13), np.float32)
    with pytest.raises(GenSim2Error, match=r"instance of drawer|no instance"):
        video.film(Replay.stored(trap / "trajectory.h5"), trap / "film.mp4")


@pytest.mark.parametrize(("name", "rows"), [("actors/drawer", 2), ("actors/drawer", 4), ("actors", 3)])
def test_states_of_a_stored_trajectory_are_as_many_as_its_actions_and_one(trap: Path, name: str, rows: int) -> None:
    import h5py
    import numpy as np

    document = trajectory(trap)
    document["env_info"]["env_kwargs"]["engine"] = "mujoco"
    (trap / "trajectory.json").write_text(json.dumps(document))
    with h5py.File(trap / "trajectory.h5", "a") as file:
        file["traj_0/env_states/articulations/panda"] = np.zeros((3, 13), np.float32)
    assert Replay.stored(trap / "trajectory.h5").states is not None
    with h5py.File(trap / "trajectory.h5", "a") as file:
        file[f"traj_0/env_states/{name}"] = np.zeros((rows, 13), np.float32)
    with pytest.raises(InputError, match=f"env_states/{name}"):
        Replay.stored(trap / "trajectory.h5")


def test_a_text_encoder_that_only_the_checkpoint_names_is_not_loaded(
    trap: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[str] = []
    monkeypatch.setattr("gensim2.policy.pretrained_text._run", lambda _, __, model: loaded.append(model) or [])
    policy = PolicyCheckpoint.load("builtin")
    foreign = policy.config.__class__.of({**policy.config.to_dict(), "text": "clip", "text_model": "box"})
    policy.network.config = foreign
    with pytest.raises(InputError, match="names the weights 'box'"):
        sentence_row(policy, "dance", trap, embed=True)
    with pytest.raises(InputError, match="names the weights 'box'"):
        check_text(None, None, ["dance"], policy)
    assert not loaded

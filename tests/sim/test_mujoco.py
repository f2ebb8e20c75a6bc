"""MuJoCo in the headless environment: without other simulators, reproducible to the byte, with the whole loop."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

from gensim2.core.errors import InputError, MissingExtraError
from gensim2.data import collect
from gensim2.planning.strategies import parse_strategy
from gensim2.rollout.chain import ChainController
from gensim2.rollout.run import run
from gensim2.scenes.config import SceneOptions
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.mujoco.description import links_of, never_touching
from gensim2.tasks.library import load_strategies, load_task

PULL_AND_PLACE = ("OpenDrawer", "PlaceGolfBallIntoDrawer")

#: Run an episode and print the digest of its states; importing another simulator ends the process.
EPISODE = """
import hashlib, sys

def refuse(event, arguments):
    if event == "import" and arguments[0].partition(".")[0] in ("sapien", "mani_skill", "torch"):
        raise SystemExit(f"imports {{arguments[0]}}")

sys.addaudithook(refuse)
sys.path.insert(0, {folder!r})
from test_mujoco import episode

print(episode({task!r}, 5))
"""


def episode(name: str, seed: int, engine: str = "mujoco") -> str:
    """Return the digest of all states and actions of an episode, and whether it succeeded."""
    import hashlib

    task = load_task(name)
    strategies = {each: parse_strategy(data, each) for each, data in load_strategies(name).items()}
    env = HeadlessEnv(task, assets="builtin", engine=engine)
    result = run(env, ChainController(task, strategies, env.profile), seed=seed, record=True)
    assert result.recording is not None
    found = hashlib.sha256(result.recording.actions.tobytes())
    for group in result.recording.env_states.values():
        for rows in group.values():
            found.update(np.ascontiguousarray(rows).tobytes())
    return f"{result.episode.held} {found.hexdigest()}"


@pytest.mark.parametrize("task", PULL_AND_PLACE)
def test_an_episode_is_the_same_in_another_process_that_has_no_other_simulator(task: str) -> None:
    here = [episode(task, 5), episode(task, 5)]
    assert here[0] == here[1]
    assert here[0].startswith("True")
    folder = __file__.rpartition("/")[0]
    code = EPISODE.format(folder=folder, task=task)
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert there.stdout.split("\n")[0] == here[0], there.stderr


@pytest.mark.parametrize(
    "name", ["CloseLaptop", "LiftBucketUpright", "SwingDoorOpen", "TurnOnFaucet", "StoreBlockInBox"]
)
def test_the_chain_holds_tasks_of_each_kind(name: str) -> None:
    assert episode(name, 5).startswith("True")


def test_a_collection_follows_from_its_arguments_alone(tmp_path: Path) -> None:
    """For any number of workers, and after any interruption."""

    def gather(folder: str, episodes: int, workers: int) -> dict[str, bytes]:
        out, given = tmp_path / folder, {"assets": "builtin", "engine": "mujoco", "seed": 3}
        collect(["CloseBox"], episodes=episodes, out=out, workers=workers, resume=out.exists(), **given)
        files = (path for path in out.rglob("*") if path.is_file() and path.name not in ("run.json", "report.html"))
        return {str(path.relative_to(out)): path.read_bytes() for path in files}

    expected = gather("at once", 3, workers=10)
    gather("resumed", 1, workers=1)
    assert gather("resumed", 3, workers=1) == expected
    record = json.loads(expected["dataset.json"])
    assert record["arguments"]["engine"] == "mujoco"
    assert "mujoco-core" in record["versions"]
    assert "sapien" not in record["versions"]


def _shaken(env: HeadlessEnv, steps: int, seed: int) -> list[dict[str, Any]]:
    draw, states = np.random.default_rng(seed), []
    for _ in range(steps):
        action = np.append(env.initial_state.start[:7], 1.0) + draw.normal(0.0, 0.3, 8)
        env.step(action)
        states.append(env.state())
    return states


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_same(one[name], other[name]) for name in one)
    return bool(np.array_equal(one, other))


def test_an_episode_goes_on_from_a_stored_state_bit_for_bit() -> None:
    """In a scene that was built again, and after objects were moved."""
    env = HeadlessEnv("PlaceGolfBallIntoDrawer", assets="builtin", engine="mujoco")
    env.reset(3)
    _shaken(env, 10, seed=0)
    env.nudge(next(iter(env.parts)), 0.01, 0.0, 0.1)
    stored = env.snapshot()
    expected = _shaken(env, 20, seed=1)
    again = HeadlessEnv("PlaceGolfBallIntoDrawer", assets="builtin", engine="mujoco")
    again.reset(3)
    again.restore(stored)
    assert again.elapsed_steps == 10
    assert all(_same(*pair) for pair in zip(expected, _shaken(again, 20, seed=1), strict=True))
    with pytest.raises(InputError, match=r"snapshot.physics"):
        again.restore(replace(stored, physics=stored.physics[:-1]))


@pytest.mark.parametrize(("task", "seed"), [("PlaceGolfBallIntoDrawer", 4), ("PlaceLemonIntoDrawer", 3)])
def test_a_stored_state_of_another_scene_is_refused(task: str, seed: int) -> None:
    env, other = (HeadlessEnv(name, assets="builtin", engine="mujoco") for name in ("PlaceGolfBallIntoDrawer", task))
    env.reset(3)
    other.reset(seed)
    stored = env.snapshot()
    assert stored.physics.shape == other.snapshot().physics.shape
    with pytest.raises(InputError, match=r"snapshot\.scene: the snapshot belongs to another scene"):
        other.restore(stored)
    env.restore(stored)


def test_sapien_refuses_to_go_on_from_a_stored_state() -> None:
    pytest.importorskip("sapien")
    env = HeadlessEnv("OpenDrawer", assets="builtin")
    env.reset(0)
    with pytest.raises(InputError, match="engine: sapien cannot resume"):
        env.snapshot()


def test_scenes_start_alike_in_both_engines() -> None:
    pytest.importorskip("sapien")
    envs = [HeadlessEnv("MoveMugIntoDrawer", assets="builtin", engine=engine) for engine in ("sapien", "mujoco")]
    for env in envs:
        env.reset(4)
    one, other = (env.scene_state() for env in envs)
    assert one.q == pytest.approx(other.q, abs=1e-6)
    assert (one.finger_friction, one.finger_stiffness) == (other.finger_friction, other.finger_stiffness)
    for name, thing in one.objects.items():
        twin = other.objects[name]
        assert thing.T_base_object == pytest.approx(twin.T_base_object, abs=2e-6)
        for body, same in zip(thing.bodies, twin.bodies, strict=True):
            assert body.name == same.name
            assert body.T_base_body == pytest.approx(same.T_base_body, abs=2e-6)
        for point, position in thing.keypoints.items():
            assert position == pytest.approx(twin.keypoints[point], abs=2e-6)
        if thing.is_rigid:
            assert (thing.friction, thing.mass) == pytest.approx((twin.friction, twin.mass), rel=1e-6)
    observed, seen = (env.observation() for env in envs)
    assert observed == pytest.approx(seen, abs=2e-6)
    states = [env.state() for env in envs]
    assert {kind: group.keys() for kind, group in states[0].items()} == {
        kind: group.keys() for kind, group in states[1].items()
    }


def test_contacts_of_the_robot_are_felt() -> None:
    env = HeadlessEnv("PushDrawerClose", assets="builtin", engine="mujoco")
    env.reset(0)
    start = np.append(env.initial_state.start[:7], 1.0)
    env.step(start)
    assert env.touched() == frozenset()
    assert env.pressing_force() == 0.0
    target = np.append(env.initial_state.start[:7], 1.0)
    target[1] += 0.9  # the shoulder moves down to the table or drawer
    forces = []
    for _ in range(30):
        env.step(target)
        forces.append(env.pressing_force())
    assert max(forces) > 1.0


def test_where_mujoco_is_not_installed_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(MissingExtraError, match=r"gensim2\[mujoco\]"):
        SceneOptions.of(assets="builtin", engine="mujoco")


@pytest.mark.parametrize("physics", ["original", "default+solver=original", "default+gripper=soft"])
def test_numbers_of_physx_are_refused_in_one_line(physics: str) -> None:
    with pytest.raises(InputError, match=r"physics: only the engine sapien supports \w+=\w+, but the engine is mujoco"):
        HeadlessEnv("OpenDrawer", assets="builtin", engine="mujoco", physics=physics)
    with pytest.raises(InputError, match="only the engine sapien supports"):
        SceneOptions("builtin", physics, engine="mujoco")


@pytest.mark.parametrize("physics", ["default+redraw=none", "default+criteria_rate=original"])
def test_what_both_engines_share_is_taken(physics: str) -> None:
    env = HeadlessEnv("OpenDrawer", assets="builtin", engine="mujoco", physics=physics)
    env.reset(0, robot=False)
    env.wait()


@pytest.mark.parametrize("content", [b"<robot>", b"<?xml version='1.0' encoding='no such'?><robot/>", b"\xff"])
def test_an_srdf_that_is_damaged_or_no_file_is_one_error(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "a.srdf"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"a\.srdf"):
        never_touching(file)
    file.unlink()
    os.mkfifo(file)
    with pytest.raises(InputError, match="is a pipe"):
        never_touching(file)
    file.unlink()
    with file.open("wb") as stream:
        stream.truncate(2**30)
    with pytest.raises(InputError, match="is larger than"):
        never_touching(file)


@pytest.mark.parametrize("content", [b"glTF\x02", b"", None])
def test_a_mesh_that_collides_and_is_damaged_or_a_pipe_is_one_error(tmp_path: Path, content: bytes | None) -> None:
    mesh = '<collision><geometry><mesh filename="a.glb"/></geometry></collision>'
    (tmp_path / "a.urdf").write_text(f'<robot name="a"><link name="body">{mesh}</link></robot>')
    if content is None:
        os.mkfifo(tmp_path / "a.glb")
    else:
        (tmp_path / "a.glb").write_bytes(content)
    with pytest.raises(InputError, match=r"a\.glb: " + ("is a pipe" if content is None else "is not a readable mesh")):
        links_of(tmp_path / "a.urdf")


@pytest.mark.parametrize("task", PULL_AND_PLACE)
def test_a_scene_as_mjcf_is_the_scene_of_the_engine(task: str, tmp_path: Path) -> None:
    import mujoco

    from gensim2.cli.main import run as command

    out = ["--to", "mjcf", "--assets", "builtin", "--seed", "4", "--out", str(tmp_path)]
    assert command(["tasks", "export", task, *out]) == 0
    model = mujoco.MjModel.from_xml_path(str(tmp_path / f"{task}.xml"))
    env = HeadlessEnv(task, assets="builtin", engine="mujoco")
    env.reset(4)
    simulation = env._scene.simulation  # type: ignore[attr-defined]
    own, data = simulation.model, mujoco.MjData(model)
    for name in ("nq", "nv", "nu", "nbody", "ngeom", "npair", "neq"):
        assert getattr(model, name) == getattr(own, name), name
    for name in ("body_mass", "dof_frictionloss", "dof_armature", "pair_friction", "actuator_forcerange", "jnt_range"):
        assert getattr(model, name) == pytest.approx(getattr(own, name), rel=1e-4, abs=1e-6), name
    mujoco.mj_resetDataKeyframe(model, data, 0)
    assert data.qpos == pytest.approx(simulation.raw.qpos, abs=1e-6)
    start = data.qpos.copy()
    mujoco.mj_step(model, data, 250)
    assert np.abs(data.qpos - start).max() < 0.02  # everything rests


@pytest.mark.parametrize("which", ["drawer/1", "mug/0"])
def test_an_object_as_mjcf_stands_on_the_table(which: str, tmp_path: Path) -> None:
    import mujoco

    from gensim2.cli.main import run as command

    words = ["assets", "export", which, "--to", "mjcf", "--assets", "builtin", "--out", str(tmp_path)]
    assert command(words) == 0
    model = mujoco.MjModel.from_xml_path(str(tmp_path / f"{which}.xml"))
    assert model.nu == 0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    start = data.qpos.copy()
    mujoco.mj_step(model, data, 250)
    assert np.abs(data.qpos - start).max() < 0.005
    assert command(words) == 2  # it is there already

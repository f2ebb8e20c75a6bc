"""Trajectory files: ManiSkill's tools read and replay them, and their bytes do not depend on the number of workers."""

from __future__ import annotations

import json
import re
import shutil
import time
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import warm
from jobs import BESIDE_A_BALL, HALFWAY, ROLE, Actions, hold, record
from pydantic import TypeAdapter

from gensim2.core.errors import InputError
from gensim2.core.processes import WorkerPool, enumerated
from gensim2.data.episode_file import episode_digest, write_episode
from gensim2.data.store import TaskStore
from gensim2.data.trajectory import H5_NAME, TrajectoryMetadata, write_trajectory
from gensim2.rollout.record import Episode, ObjectRecord
from gensim2.rollout.recording import Recording
from gensim2.rollout.run import run
from gensim2.sim.headless import HeadlessEnv
from gensim2.sim.rendering import can_render
from gensim2.tasks.library import load_task
from gensim2.tasks.parse import parse_task
from gensim2.tasks.spec import TaskSpec

SEEDS = (0, 1, 2)


def _provenance(task: TaskSpec | None = None) -> TrajectoryMetadata:
    return TrajectoryMetadata(
        task=task or parse_task(HALFWAY),
        strategies={"push": {"gripper": "open"}},
        assets="builtin",
        licenses={f"drawer/{n}": "CC0-1.0" for n in range(100)} | {"golf_ball/0": "CC-BY-4.0"},
        seed=0,
        details={"versions": {"python": "3"}},
    )


def _merge(store: TaskStore, provenance: TrajectoryMetadata, digests: dict[int, str | None] | None = None) -> None:
    """Merge the episodes with these digests, or all."""
    found = {each.index: each.episode_digest for each in store.logged()} if digests is None else digests
    write_trajectory(store.folder, provenance, [(store.path(index), digest) for index, digest in found.items()])


def _entries(store: TaskStore) -> list[dict[str, Any]]:
    return list(json.loads((store.folder / "trajectory.json").read_text())["episodes"])


def _h5(store: TaskStore) -> Path:
    return store.folder / H5_NAME


def _collect(folder: Path, workers: int, several: bool = False) -> TaskStore:
    store = TaskStore(folder)
    with WorkerPool(workers) as pool:
        for outcome in pool.map_unordered(record, enumerated((seed, several) for seed in SEEDS)):
            result = outcome.unwrap()
            assert result.recording is not None
            # Failed episodes can be replayed as well.
            write_episode(store.path(outcome.index), result.episode, result.recording)
    task = parse_task(BESIDE_A_BALL if several else HALFWAY)
    digests = {index: episode_digest(store.path(index)) for index in range(len(SEEDS))}
    _merge(store, _provenance(task), dict(digests))
    return store


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> TaskStore:
    return _collect(tmp_path_factory.mktemp("inline"), 0)


@pytest.fixture(scope="module")
def replayed(store: TaskStore, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    return _replay(_h5(store), tmp_path_factory.mktemp("replayed"))


def _replay(trajectory: Path, folder: Path) -> tuple[Path, str]:
    """Return the output of ManiSkill's command in a folder with only the two files."""
    for suffix in (".h5", ".json"):
        shutil.copy(trajectory.with_suffix(suffix), folder)
    words = ["--traj-path", "trajectory.h5", "--save-traj", "--allow-failure"]
    done = warm.run("-m", "mani_skill.trajectory.replay_trajectory", *words, cwd=folder)
    assert done.returncode == 0, done.stderr
    (output,) = folder.glob("trajectory.*.h5")
    return output, done.stdout


def test_the_episodes_are_of_different_objects_and_of_both_outcomes(store: TaskStore) -> None:
    entries = _entries(store)
    assert len({entry["instances"][ROLE] for entry in entries}) > 1
    assert {entry["success"] for entry in entries} == {True, False}
    assert [entry["episode"]["held"] for entry in entries] == [entry["success"] for entry in entries]


def test_maniskill_replays_every_episode_to_the_same_flags_and_states(
    store: TaskStore, replayed: tuple[Path, str]
) -> None:
    _check_replayed(store, *replayed, {f"env_states/articulations/{ROLE}"})


def test_maniskill_replays_scenes_of_several_objects(tmp_path: Path) -> None:
    several = _collect(tmp_path / "recorded", 0, several=True)
    (tmp_path / "replayed").mkdir()
    output, words = _replay(_h5(several), tmp_path / "replayed")
    _check_replayed(several, output, words, {f"env_states/articulations/{ROLE}", "env_states/actors/ball"})
    document = json.loads(_h5(several).with_suffix(".json").read_text())
    assert document["gensim2"]["licenses"]["golf_ball/0"] == "CC-BY-4.0"
    for entry in document["episodes"]:
        assert set(entry["episode"]["objects"]) == set(entry["instances"]) == {ROLE, "ball"}
        assert entry["episode"]["objects"]["ball"]["pose_end"] is not None


def _check_replayed(store: TaskStore, output: Path, words: str, expected: set[str]) -> None:
    assert re.search(rf"Replayed {len(SEEDS)} episodes, {len(SEEDS)}/{len(SEEDS)}=100", words)
    with h5py.File(_h5(store)) as ours, h5py.File(output) as theirs:
        assert set(ours) == set(theirs) == {f"traj_{n}" for n in range(len(SEEDS))}
        for name in ours:
            found: dict[str, Any] = {}
            theirs[name].visititems(
                lambda path, item, found=found: found.update({path: item}) if hasattr(item, "shape") else None
            )
            assert {"actions", "success"} | expected <= set(found)
            for path, dataset in found.items():
                mine = ours[name][path]
                assert mine.shape == dataset.shape, path
                assert mine.dtype == dataset.dtype, path
                if path != "rewards":  # recorded only if requested
                    assert np.array_equal(mine[:], dataset[:]), path


def test_a_replayed_file_can_be_replayed_again(replayed: tuple[Path, str]) -> None:
    document = json.loads(replayed[0].with_suffix(".json").read_text())
    assert document["env_info"]["env_id"] == "gensim2.sim:GenSim2-Task-v1"
    assert document["env_info"]["env_kwargs"]["task"]["name"] == HALFWAY["name"]


def test_files_of_schema_version_1_replay(store: TaskStore) -> None:
    """ManiSkill's command with a file from the time when a task had one object without a name."""
    import gymnasium as gym

    document = json.loads(_h5(store).with_suffix(".json").read_text())
    former_kwargs = {**document["env_info"]["env_kwargs"], "task": HALFWAY, "instances": ["0", "1"]}
    for entry in document["episodes"][:2]:
        id = entry["instances"][ROLE]
        former_kwargs["instances"] = sorted({*former_kwargs["instances"], id})
        env = gym.make(document["env_info"]["env_id"], **former_kwargs)
        env.reset(seed=entry["episode_seed"], options={"instance": id})
        with h5py.File(_h5(store)) as file:
            recorded = file[f"traj_{entry['episode_id']}"]
            success = [bool(env.step(action)[4]["success"][0]) for action in recorded["actions"]]
            assert success == recorded["success"][:].tolist()
        env.close()


def test_maniskills_dataset_reads_the_file(store: TaskStore) -> None:
    from mani_skill.trajectory.dataset import ManiSkillTrajectoryDataset

    data = ManiSkillTrajectoryDataset(str(_h5(store)))
    assert len(data) == sum(entry["elapsed_steps"] for entry in _entries(store))
    assert data[0]["obs"].ndim == 1


def test_the_number_of_workers_does_not_change_a_byte(store: TaskStore, tmp_path: Path) -> None:
    time.sleep(1.1)  # times in file formats have seconds
    other = _collect(tmp_path, 2)
    for suffix in (".h5", ".json"):
        mine, theirs = _h5(store).with_suffix(suffix), _h5(other).with_suffix(suffix)
        assert mine.read_bytes() == theirs.read_bytes(), suffix


def test_the_json_file_carries_where_the_data_comes_from(store: TaskStore) -> None:
    document = json.loads(_h5(store).with_suffix(".json").read_text())
    extra = document["gensim2"]
    assert parse_task(extra["task"]) == parse_task(HALFWAY)
    assert extra["strategies"] == {"push": {"gripper": "open"}}
    used = {f"drawer/{entry['instances'][ROLE]}" for entry in document["episodes"]}
    assert extra["licenses"] == dict.fromkeys(used, "CC0-1.0")
    assert document["source_type"] == "motionplanning"
    for number, entry in enumerate(document["episodes"]):
        assert entry["episode_id"] == number
        assert entry["episode_seed"] == entry["reset_kwargs"]["seed"] == SEEDS[number]


def test_reset_options_are_recorded_so_that_a_replay_starts_alike() -> None:
    lane = HeadlessEnv(HALFWAY, assets="builtin")
    options = {"openness": np.float32(0.25), "offset": np.array([0.01, 0.0, 0.1]), "instance": "3"}
    recording = run(lane, Actions(hold), seed=3, options=options, record=True).recording
    assert recording is not None
    told = json.loads(json.dumps(recording.reset_options))
    again = run(lane, Actions(hold), seed=recording.seed, options=told, record=True).recording
    assert again is not None
    assert np.array_equal(recording.obs, again.obs)
    assert told["openness"] == pytest.approx(0.25)
    assert told["instance"] == {ROLE: "3"}


def _blank(steps: int = 3, seed: int = 0, task: str = HALFWAY["name"]) -> tuple[Episode, Recording]:
    name = next(iter(load_task(task).objects)) if task != HALFWAY["name"] else ROLE
    recording = Recording(
        seed=seed,
        reset_options={"instance": {name: "0"}},
        instances={name: "0"},
        control_mode="pd_joint_pos",
        actions=np.zeros((steps, 8), np.float32),
        obs=np.zeros((steps + 1, 4), np.float32),
        env_states={"articulations": {name: np.full((steps + 1, 15), seed, np.float32)}},
        rewards=np.zeros(steps, np.float32),
        terminated=np.zeros(steps, bool),
        truncated=np.zeros(steps, bool),
        success=np.ones(steps, bool),
    )
    thing = ObjectRecord("drawer", "0", "generated", "ab", [0.0] * 7, 0.0, 0.5, 0.1)
    episode = Episode(
        seed=seed,
        objects={name: thing},
        placement_draws=1,
        steps=[],
        control_steps=steps,
        paper=True,
        held=True,
        strict=True,
        strict_misses=[],
        still=False,
        settled=True,
        truncated=False,
        cause=None,
    )
    return episode, recording


def test_finished_episodes_outlive_an_interruption_and_are_merged_in_order(tmp_path: Path) -> None:
    first = TaskStore(tmp_path)
    first.add(5, *_blank(seed=5, task="OpenDrawer"))
    first.add(2, *_blank(seed=2, task="OpenDrawer"))
    (tmp_path / "episodes" / ".000003.h5.half").write_bytes(b"half an episode")
    second = TaskStore(tmp_path)  # as after an interruption
    assert [each.index for each in second.logged()] == [2, 5]
    second.add(3, *_blank(seed=3, task="OpenDrawer"))
    _merge(second, _provenance(load_task("OpenDrawer")))
    document = json.loads((tmp_path / "trajectory.json").read_text())
    assert [entry["episode_seed"] for entry in document["episodes"]] == [2, 3, 5]
    told = TypeAdapter(Episode).validate_json(json.dumps(document["episodes"][0]["episode"]))
    assert told == _blank(seed=2, task="OpenDrawer")[0]
    assert document["env_info"]["env_id"] == "gensim2.sim:GenSim2-OpenDrawer-v1"
    assert "task" not in document["env_info"]["env_kwargs"]
    with h5py.File(_h5(second)) as file:
        values = [file[f"traj_{n}/env_states/articulations/drawer"][0, 0] for n in range(3)]
    assert values == [2, 3, 5]


def test_a_broken_episode_file_is_named(tmp_path: Path) -> None:
    store = TaskStore(tmp_path)
    store.add(0, *_blank())
    (tmp_path / "episodes" / "000001.h5").write_bytes(b"not hdf5")
    whole = episode_digest(store.path(0))
    for broken in ({0: whole, 1: "ab"}, {1: None}, {7: "ab"}):
        with pytest.raises(
            InputError, match=r"00000[17]\.h5: (is not a finished episode|cannot be read: No such file)"
        ):
            _merge(store, _provenance(), broken)
    with pytest.raises(InputError, match="no finished episode"):
        _merge(TaskStore(tmp_path / "empty"), _provenance(), {})


def test_nothing_is_written_where_it_may_not_be(tmp_path: Path) -> None:
    target = tmp_path / "file"
    target.write_text("in the way")
    with pytest.raises(InputError, match="cannot write"):
        TaskStore(target).add(0, *_blank())


def test_without_sapiens_renderer_the_ray_caster_draws_the_states(
    store: TaskStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import imageio.v2 as imageio

    from gensim2.data.close_up import FRAME, FRAME_WIDTH, SHARE
    from gensim2.data.video import Replay, film
    from gensim2.sim import driver

    monkeypatch.setattr(driver, "can_render", lambda: False)
    driver.renderer.cache_clear()
    try:
        replay = Replay.stored(_h5(store))
        assert replay.states is not None
        made = film(replay, tmp_path / "video.mp4", still=tmp_path / "still.png", stride=20)
    finally:
        driver.renderer.cache_clear()
    assert made.success is None
    assert made.renderer == "the ray caster draws, because SAPIEN finds no Vulkan driver"
    edge = int(SHARE * 480) + FRAME_WIDTH
    assert imageio.imread(tmp_path / "still.png")[-edge, -edge].tolist() == list(FRAME)  # of the close-up
    frames = [np.asarray(frame) for frame in imageio.get_reader(tmp_path / "video.mp4")]
    assert len(frames) == made.frames
    assert frames[0].shape == (480, 640, 3)
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 30  # the arm has moved


@pytest.mark.skipif(not can_render(), reason="no Vulkan driver works on this machine")
def test_a_film_shows_the_recorded_episode(store: TaskStore, tmp_path: Path) -> None:
    import imageio.v2 as imageio

    from gensim2.data.video import Replay, film

    short = TaskStore(tmp_path)
    result = record(0)
    recording = result.recording
    assert recording is not None
    import dataclasses

    cut = {name: getattr(recording, name)[:8] for name in ("actions", "rewards", "terminated", "truncated", "success")}
    digest = write_episode(short.path(0), result.episode, dataclasses.replace(recording, **cut))
    _merge(short, _provenance(), {0: digest})
    replay = Replay.stored(_h5(short))
    film_of_it = film(replay, tmp_path / "video.mp4", still=tmp_path / "still.png")
    assert (film_of_it.frames, film_of_it.renderer) == (9, "SAPIEN's renderer draws")
    frames = [np.asarray(frame) for frame in imageio.get_reader(tmp_path / "video.mp4")]
    assert len(frames) == 9
    assert frames[0].shape == (480, 640, 3)
    assert np.abs(frames[0].astype(int) - frames[-1]).max() > 30  # the arm moved
    assert imageio.imread(tmp_path / "still.png").shape == (480, 640, 3)
    assert film(replay, tmp_path / "quick.mp4", still=tmp_path / "still.webp", stride=4, speed=2).frames == 3
    told = imageio.get_reader(tmp_path / "quick.mp4").get_meta_data()
    assert told["fps"] == 10  # twice the speed of 5 Hz
    assert "yuv420p" in told["pix_fmt"]  # supported by every browser
    assert imageio.imread(tmp_path / "still.webp").shape == (480, 640, 3)
    with pytest.raises(InputError, match="no episode 7"):
        Replay.stored(_h5(short), episode=7)

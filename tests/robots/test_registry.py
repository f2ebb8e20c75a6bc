"""User robots: registered or from a file, available in workers, and refused in one line if invalid."""

from __future__ import annotations

import textwrap
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warm

pytest.importorskip("mani_skill")

import gensim2
from gensim2.core.errors import InputError
from gensim2.core.processes import Job, WorkerPool, results
from gensim2.robots import Mimic, RobotProfile, load_robot, robot, robot_key, robot_names
from gensim2.robots.checks import check_profile
from gensim2.scenes.config import SceneOptions

EXAMPLES = Path(__file__).parents[2] / "examples" / "robots"
XARM = EXAMPLES / "xarm7.py"


def reach_of(name: str) -> float:
    """Return the reach; called in a worker."""
    return robot(name).reach


def write(folder: Path, body: str) -> Path:
    file = folder / "mine.py"
    file.write_text("import gensim2\nfrom dataclasses import replace\n" + textwrap.dedent(body))
    return file


MINE = """
    @gensim2.register_robot
    def mine():
        return replace(gensim2.robot("panda"), name="mine", reach=0.7125)
"""


def test_a_file_describes_a_robot_and_workers_load_it(tmp_path: Path) -> None:
    file = write(tmp_path, MINE)
    key = load_robot(file)
    assert robot(key).reach == 0.7125
    assert robot(key) is robot(robot_key(key))
    assert SceneOptions.of(assets="builtin", robot=key).robot == key
    assert Path(key).is_absolute()
    assert load_robot(tmp_path / "beside" / ".." / file.name) == key
    with WorkerPool(1) as pool:
        found = list(results(pool.map_unordered(reach_of, [Job(0, (key,))]), "robots", tmp_path / "log"))
    assert found == [(0, 0.7125)]


def test_a_registered_robot_is_known_by_name_here_and_by_place_elsewhere(tmp_path: Path) -> None:
    script = write(
        tmp_path,
        MINE
        + """
    if __name__ == "__main__":
        print(gensim2.robot("mine").reach, gensim2.robot_names(), gensim2.robots.robot_key("mine"))
    """,
    )
    done = warm.run(script)
    assert done.returncode == 0, done.stderr
    out = done.stdout
    assert out.split()[0] == "0.7125"
    assert "'mine'" in out
    assert f"{script}:mine" in out


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero (line 3)"),
        ("def f(:\n    pass", "SyntaxError"),
        ("x = 1", "registers no robot"),
        ("@gensim2.register_robot\ndef odd():\n    return 3", "must return a RobotProfile"),
        (
            "@gensim2.register_robot\ndef odd2():\n    raise OSError('no URDF')",
            "odd2() raises OSError: no URDF (line 5)",
        ),
        (
            "@gensim2.register_robot\ndef panda():\n    return gensim2.robot()",
            "a robot named 'panda' is already registered",
        ),
        (
            "@gensim2.register_robot\ndef a1():\n    pass\n@gensim2.register_robot\ndef a2():\n    pass",
            "registers a1, a2",
        ),
        (
            "@gensim2.register_robot\ndef odd3():\n    return replace(gensim2.robot(), name='odd3', control_hz=30)",
            "the physics rate, 100 Hz, is not a multiple of the control rate, 30 Hz",
        ),
        (
            "def gone():\n    raise KeyError('where')\n@gensim2.register_robot\ndef odd4():\n"
            "    return replace(gensim2.robot(), name='odd4', files=gone)",
            "odd4.files: files() raises KeyError: 'where' (line 4)",
        ),
        (
            "from gensim2.robots import RobotFiles\n@gensim2.register_robot\ndef odd5():\n"
            "    files = lambda: RobotFiles('/nowhere.urdf', '/nowhere.srdf')\n"
            "    return replace(gensim2.robot(), name='odd5', files=files)",
            "/nowhere.urdf",
        ),
    ],
)
def test_what_cannot_be_used_is_told_on_one_line(tmp_path: Path, body: str, message: str) -> None:
    file = write(tmp_path, body)
    with pytest.raises(InputError) as refused:
        load_robot(file)
    line = str(refused.value)
    assert message in line
    assert "\n" not in line
    assert "mine.py" in line


def test_a_file_that_was_mended_is_read_again(tmp_path: Path) -> None:
    file = write(tmp_path, "x = 1")
    with pytest.raises(InputError, match="registers no robot"):
        load_robot(file)
    write(tmp_path, MINE.replace("mine", "mended"))
    assert robot(load_robot(file)).name == "mended"


def test_a_robot_is_one_whatever_it_is_called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write(tmp_path, MINE.replace("mine", "many_named"))
    monkeypatch.chdir(tmp_path)
    found = robot(load_robot("mine.py"))
    assert robot(str(file)) is robot(load_robot("mine.py:many_named")) is robot("many_named") is found


def test_files_that_are_not_there_are_told_with_what_other_machines_need(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the file does not exist on the machine .*all machines that the run uses"):
        load_robot(tmp_path / "gone.py")
    with pytest.raises(InputError, match="no robot 'make' in the module 'nowhere_to_be_found'"):
        load_robot("nowhere_to_be_found:make")
    assert robot(load_robot("gensim2.robots.panda:panda")).name == "panda"


def test_functions_that_no_worker_could_find_are_not_registered() -> None:
    with pytest.raises(InputError, match="at module level"):
        gensim2.register_robot(lambda: robot("panda"))
    assert set(robot_names()) >= {"panda", "fetch"}


def changed(profile: RobotProfile, **gripper: object) -> RobotProfile:
    return replace(profile, gripper=replace(profile.gripper, **gripper))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda p: replace(p, base_quaternion=(1.0, 1.0, 0.0, 0.0)), "unit quaternion"),
        (lambda p: replace(p, reset_qpos=p.reset_qpos[:-1]), "11 values for 12 joints"),
        (lambda p: replace(p, reset_qpos=(9.0, *p.reset_qpos[1:])), "places the joint joint1 outside its limits"),
        (lambda p: replace(p, arm_joints=p.arm_joints[:-1]), "but the moving joints of the URDF"),
        (lambda p: replace(p, tool_link="elsewhere"), "no link 'elsewhere'"),
        (lambda p: replace(p, tool_keypoints={}), "the keypoint tool_head is missing"),
        (lambda p: replace(p, tool_keypoints={**p.tool_keypoints, "tool_head": np.zeros(2)}), "three finite numbers"),
        (lambda p: changed(p, pads=("nothing",)), "no link 'nothing'"),
        (lambda p: changed(p, passive=()), "is listed in no field"),
        (
            lambda p: changed(p, mimics={**p.gripper.mimics, "left_rack_joint": Mimic("pinion_joint", 0.03)}),
            "in the URDF differs",
        ),
        (lambda p: replace(p, simulation=replace(p.simulation, arm=(p.simulation.arm,) * 3)), "3 drives for 7"),
    ],
)
def test_profiles_that_contradict_themselves_or_their_urdf_are_refused(wrong: object, message: str) -> None:
    assert callable(wrong)
    with pytest.raises(InputError, match=message):
        check_profile(wrong(robot(load_robot(XARM))), "mine.py")

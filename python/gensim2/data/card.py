"""Write a data set's card, ``README.md``, with a metadata header for sites that host data sets."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.core.plural import plural
from gensim2.data.dataset import DataSet
from gensim2.data.formats.columns import lerobot_name
from gensim2.data.store import TaskStore
from gensim2.perception.observation import CLOUD, ENVIRONMENT_STATE, IMAGE
from gensim2.robots import RobotProfile, robot
from gensim2.rollout.record import Episode
from gensim2.rollout.tally import interval

CARD = "README.md"

#: Characters with a special meaning in Markdown or HTML, and control characters.
_SPECIAL = re.compile(r"[<>&|\\`*_\[\]~$!:@#]|[^\S ]|[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")

_HOW_TO_READ = {
    "native": """```python
from pathlib import Path
from gensim2.data import DataSet

dataset = DataSet.open(Path("."))
for name in dataset.tasks:
    for row in dataset.task(name).rows():           # every episode, also failed ones
        if row.held:
            stored = dataset.task(name).read(row)   # stored.recording: states and actions
```""",
    "maniskill": """```bash
python -m mani_skill.trajectory.replay_trajectory --traj-path TASK/trajectory.h5
```""",
    "lerobot": """```python
from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset("local/name", root=".")
print(dataset[0]["task"], dataset[0]["observation.state"])
```""",
    "zarr": """```python
import zarr

root = zarr.open(".", mode="r")
ends = root["meta/episode_ends"][:]
state, action = root["data/state"][: ends[0]], root["data/action"][: ends[0]]   # the first episode
```""",
}


def card(path: Path) -> Path:
    """Write the card of a data set into its folder and return the file.

    Raises:
        InputError: the data set cannot be read, its collection is incomplete, or no episode succeeded.
    """
    dataset = DataSet.open(path)
    stores = [dataset.task(name) for name in dataset.tasks]
    described = [Described.of(store, (row for row in store.rows() if row.held)) for store in stores]
    if not any(one.episodes for one in described):
        raise InputError("no episode succeeded", file=path, remedy="collect more")
    return write_card(dataset, [one for one in described if one.episodes], path, "native")


@dataclass(frozen=True)
class Described:
    """Data about one task's episodes for a data set card.

    Attributes:
        store: folder of the task's stored episodes.
        steps: number of control steps in these episodes.
        objects: class and id of each object in these episodes.
    """

    store: TaskStore
    episodes: int
    steps: int
    objects: frozenset[tuple[str, str]]

    @staticmethod
    def of(store: TaskStore, rows: Iterable[Episode]) -> Described:
        """Count the episodes in ``rows``; only one episode is in memory at a time."""
        episodes = steps = 0
        objects: set[tuple[str, str]] = set()
        for row in rows:
            episodes, steps = episodes + 1, steps + row.control_steps
            objects |= {(thing.asset_class, thing.id) for thing in row.objects.values()}
        return Described(store, episodes, steps, frozenset(objects))


def write_card(dataset: DataSet, described: Sequence[Described], out: Path, kind: str) -> Path:
    """Write ``README.md``, the card of a data set or export, which describes the episodes. Return its path.

    Args:
        described: for each task, the number of episodes and steps, and the objects.
        kind: ``"native"`` or the name of an export format.
    """
    write_atomic(out / CARD, _text(dataset, described, kind))
    return out / CARD


def _text(dataset: DataSet, described: Sequence[Described], kind: str) -> str:
    record, scene = dataset.record, dataset.record.scene
    profile = robot(scene.robot)
    episodes, steps = sum(one.episodes for one in described), sum(one.steps for one in described)
    used = {f"{asset_class}/{id}" for one in described for asset_class, id in one.objects}
    licenses = sorted({record.objects[name].license for name in used if name in record.objects})
    tags = ["gensim2", "manipulation", *(["LeRobot"] if kind == "lerobot" else [])]
    lines = [
        "---",
        "license: other",
        "task_categories:",
        "- robotics",
        "tags:",
        *(f"- {tag}" for tag in tags),
        "---",
        "",
        f"# {plural(episodes, 'demonstration')} of {plural(len(described), 'manipulation task')}",
        "",
        f"Made by gensim2 {_text_of(record.versions.get('gensim2', ''))}: planned by its keypoint solver, run and",
        f"verified in simulation. {plural(steps, 'control step')} at {profile.control_hz} a second,",
        f"{plural(len(used), 'different object')}.",
        "",
        *_table(
            ("task", "what", "episodes here", "tried", "held (95 % interval)", "strict", "objects"),
            (_row(dataset, one) for one in described),
        ),
        "",
        "`held` (success): the goal is reached at the end, everything is at rest, and an idle arm would fail.",
        "`strict`: also, the hand has let go and retreated, no other object was moved, and the goal keeps holding.",
        "",
        "## How it was made",
        "",
        *_table(
            ("", ""),
            [
                ("robot", scene.robot),
                ("objects", "generated" if scene.assets == "builtin" else "from a folder"),
                ("engine", scene.engine),
                ("physics", scene.physics),
                ("randomization", scene.randomization),
                ("seed", str(record.seed)),
                ("episodes tried of each task", str(record.episodes)),
                *([("control", "open loop")] if record.rollout.open_loop else []),
                *([("noise on the commands", f"{record.rollout.noise:g} rad")] if record.rollout.noise else []),
                *((f"version of {name}", version) for name, version in sorted(record.versions.items())),
            ],
        ),
        "",
        "Every episode depends only on the seed, its task and its index: the same command gives the same bytes.",
        "",
        "## Licences",
        "",
        "The licences of the objects also apply to these data:",
        "",
        *(f"- {_with_objects(license, used, dataset)}" for license in licenses),
        "",
        *_frames(profile, kind),
        "## How to read it",
        "",
        _HOW_TO_READ[kind],
        "",
    ]
    return "\n".join(lines)


def _frames(profile: RobotProfile, kind: str) -> list[str]:
    """Return the card's section on the contents of a frame; empty for formats without frames."""
    if kind not in ("lerobot", "zarr"):
        return []
    joints, arm = ", ".join(profile.model.joint_names), ", ".join(profile.arm_joints)
    hertz = profile.control_hz
    meanings = {
        "state": f"joint positions, rad (sliding joints m): {joints}",
        "velocity": "velocities of these joints, rad/s (m/s)",
        "tool_pose": "pose of the tool in the base frame: x, y, z in m, unit quaternion qw, qx, qy, qz, qw at least 0",
        "gripper": "distance between the finger pads, m, and the last gripper command, -1 (closed) to 1 (open)",
        "action": f"absolute target positions of the arm's joints, rad ({arm}), and the gripper's target from -1 "
        f"(closed) to 1 (open): sent to the drives for 1/{hertz} s after this frame was seen",
        "reward": "1 if the goal holds after the action, else 0",
        "success": "whether the goal holds after the action",
        "done": "whether this is the episode's last action",
        CLOUD: "points in the base frame: x, y, z in m, then red, green, blue from 0 to 1; only if rendered",
        ENVIRONMENT_STATE: "keypoints of the objects and corners of their boxes in the base frame: x, y, z of "
        "each in m, which only a simulator knows; only if rendered instead of points",
        f"{IMAGE}CAMERA": "a camera's picture, 8 bits a channel, red green blue; only if rendered",
    }
    named = {lerobot_name(column) if kind == "lerobot" else column: text for column, text in meanings.items()}
    return [
        "## What a frame holds",
        "",
        f"The base frame is that of the {profile.name}'s base: x ahead, y to its left, z up.",
        f"Frames are 1/{hertz} s apart.",
        "",
        *_table(("column", "meaning"), [(str(column), text) for column, text in named.items()]),
        "",
    ]


def _row(dataset: DataSet, described: Described) -> tuple[str, ...]:
    name, task = described.store.name, dataset.record.tasks[described.store.name]
    tried, held = task.tried or 0, task.held or 0
    low, high = interval(held, tried)
    rate = f"{held / tried:.2f} ({low:.2f} to {high:.2f})" if tried else ""
    strict = f"{(task.strict or 0) / tried:.2f}" if tried else ""
    counts = str(described.episodes), str(tried), rate, strict, str(len(described.objects))
    return name, described.store.spec().description, *counts


def _with_objects(license: str, used: set[str], dataset: DataSet) -> str:
    found = dataset.record.objects
    classes = sorted({name.split("/")[0] for name in used if name in found and found[name].license == license})
    return f"{_text_of(license)} ({_text_of(', '.join(classes))})"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    lines = [head, ["---"] * len(head), *([_text_of(cell) for cell in row] for row in rows)]
    return [f"| {' | '.join(cells)} |" for cells in lines]


def _text_of(text: str) -> str:
    """Escape text for Markdown and HTML on one line, because descriptions may be untrusted."""
    return _SPECIAL.sub(lambda found: f"&#{ord(found[0])};", " ".join(text.split()))

"""Show the running control loop in the browser with viser: point clouds, robot, next actions and timing."""

from __future__ import annotations

import sys
import threading
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from gensim2.perception import Observation, ObservationSpec
from gensim2.perception.observation import CLOUD
from gensim2.perception.raycast.kinematics import Tree, read_urdf
from gensim2.perception.raycast.shapes import read_links
from gensim2.planning.show import open_page, quaternion
from gensim2.robots import OPEN, robot
from gensim2.rollout.controller import PROPRIOCEPTIVE
from gensim2.rollout.controller_spec import ControllerSpec
from gensim2.viewing import CLOUD_POINT, draw_solid
from gensim2_kpam.show import add_text, plain_markdown
from gensim2_robot.devices import ArmState, CameraFrame
from gensim2_robot.limits import Sent
from gensim2_robot.mind import ControllerAnswer, Question
from gensim2_robot.watch import WatchRules

EVERY = 0.1
"""Time between two updates of the page, s."""
NEXT = (255, 120, 0)
"""Colour in which the tool positions at the next actions are drawn."""
NEXT_POINT = 0.012
"""Size of the points that mark the tool positions at the next actions, m."""


PATIENT = WatchRules(
    frame_age=np.inf,
    apart=np.inf,
    no_action=np.inf,
    thinking=np.inf,
    late_answers=sys.maxsize,
    state_age=np.inf,
    behind=np.inf,
    overrun=np.inf,
)
"""Watchdog settings for showing data without motion: delays do not trigger the watchdog."""


class LivePage:
    """Web page that shows a run live, with the data of a log. A separate thread draws the newest data.

    Args:
        robot_name: name of the robot.
        title: title of the page.
        host: address to listen on.
        port: port of the page; if the port is in use, the next free port is used.

    Attributes:
        trouble: always None. A log reports failures here, and the watchdog then holds the arm.

    Raises:
        InputError: a file of the robot cannot be used.
        MissingExtraError: viser is not installed.
    """

    trouble: str | None = None

    def __init__(self, robot_name: str, title: str, *, host: str = "localhost", port: int = 8080) -> None:
        profile = self._profile = robot(robot_name)
        server = self.server = open_page(host, port, (1.6, -1.2, 1.0), (0.4, 0.0, 0.2), title)
        self._tree = Tree.of(read_urdf(profile.urdf), (*profile.arm_joints, *profile.gripper.joints))
        surfaces = read_links(self._tree.file)
        self._links = [
            (number, draw_solid(server, ("robot", name), surface))
            for number, name in enumerate(self._tree.names)
            if (surface := surfaces[name]) is not None
        ]
        # three.js cannot draw an empty point cloud, so the clouds start with one hidden point
        nowhere, black = np.zeros((1, 3), np.float32), np.zeros((1, 3), np.uint8)
        self._cloud, self._next = (
            server.scene.add_point_cloud(name, nowhere, black, point_size=size, visible=False)
            for name, size in (("/cloud", CLOUD_POINT), ("/next", NEXT_POINT))
        )
        self._stand(np.array(profile.reset_qpos))
        self._said = add_text(server, "Waiting for data")
        self._state: ArmState | None = None
        self._answer: ControllerAnswer | None = None
        self._watch, self._clocks = "idle", ""
        self._drawn: tuple[ArmState | None, ControllerAnswer | None] = (None, None)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="page", daemon=True)
        self._thread.start()

    @property
    def shown(self) -> list[str]:
        """Names of the links of the robot that the page draws."""
        return [self._tree.names[number] for number, _ in self._links]

    @property
    def url(self) -> str:
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Draw the last data, and close the page."""
        self._over.set()
        self._thread.join(timeout=3.0)
        self.server.stop()

    def state(self, state: ArmState) -> None:
        self._state = state

    def answer(self, time: float, answer: ControllerAnswer) -> None:
        self._answer = answer

    def change(self, time: float, state: str, reason: str) -> None:
        self._watch = f"{state}: {reason}"

    def clocks(self, time: float, late: float, ages: dict[str, float]) -> None:
        images = ", ".join(f"{name} {1e3 * age:.0f} ms" for name, age in ages.items())
        self._clocks = f"Control period: {1e3 * late:.1f} ms late. Age of the images: {images}"

    def frame(self, frame: CameraFrame) -> None:
        """Do nothing, because the page shows images as point clouds."""

    def sent(self, time: float, sent: Sent, gripper: float) -> None:
        """Do nothing, because the page shows the measured arm."""

    def question(self, time: float, question: Question) -> None:
        """Do nothing, because the page shows the answer to the request."""

    def _run(self) -> None:
        while not self._over.wait(EVERY):
            self.draw()
        self.draw()

    def draw(self) -> None:
        state, answer = self._state, self._answer
        with self.server.atomic():
            if state is not None and state is not self._drawn[0]:
                self._stand(state.q)
            if answer is not None and answer is not self._drawn[1]:
                self._draw_answer(answer, state)
            self._said.content = plain_markdown(*self._words(state, answer))
        self._drawn = state, answer

    def _stand(self, q: npt.NDArray[np.float64]) -> None:
        poses = self._tree.poses(np.eye(4)[None], q[None])[0]
        for number, handle in self._links:
            handle.position, handle.wxyz = poses[number][:3, 3], quaternion(poses[number])

    def _draw_answer(self, answer: ControllerAnswer, state: ArmState | None) -> None:
        cloud = answer.seen.get(CLOUD)
        if cloud is not None:
            _show_points(self._cloud, cloud[:, :3].astype(np.float32), (255 * cloud[:, 3:6]).astype(np.uint8))
        if state is not None:
            tools = self.tools(answer.actions, state.q)
            _show_points(self._next, tools, np.full((len(tools), 3), NEXT, np.uint8))

    def tools(self, actions: npt.NDArray[np.float32], q: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:
        """Return the tool positions (k, 3), m, after actions (k, m + 1).

        Other joints keep their values in ``q`` (n,).
        """
        found = []
        for action in actions[np.isfinite(actions).all(axis=1)] if actions.ndim == 2 else ():
            if len(action) == self._profile.action_size:
                there = q.copy()
                there[list(self._profile.arm_columns)] = action[:-1]
                found.append(self._profile.model.forward_kinematics(there, self._profile.tool_link)[:3, 3])
        return np.array(found, dtype=np.float32).reshape(-1, 3)

    def _words(self, state: ArmState | None, answer: ControllerAnswer | None) -> list[str]:
        lines = [f"Watchdog: {self._watch}"]
        if state is not None:
            lines.append(f"Arm: {state.mode}, external force {state.force:.0f} N")
        if answer is not None:
            if answer.cloud_ms is not None:
                lines.append(f"Point cloud: ready {answer.cloud_ms:.0f} ms after its images")
            lines.append(f"Controller: {len(answer.actions)} actions, computed in {answer.acting_ms:.0f} ms")
            if answer.refusal is not None:
                lines.append(f"The controller refuses: {answer.refusal}")
        return [*lines, self._clocks]


def _show_points(handle: Any, points: npt.NDArray[np.float32], colors: npt.NDArray[np.uint8]) -> None:
    handle.visible = len(points) > 0
    if len(points):
        handle.points, handle.colors = points, colors


class Looking:
    """Controller for watching only, which makes observations and whose actions keep the arm where the episode started.

    Args:
        arm: how many joints the arm has.
        cameras: names of the cameras to use; None: the default cameras.
        clouds: whether to compute point clouds, which need calibrated cameras.
    """

    def __init__(self, arm: int, cameras: Sequence[str] | None = None, clouds: bool = True) -> None:
        seen = ObservationSpec.of(None if cameras is None else {"cameras": list(cameras)})
        self.observation_spec = seen if clouds else PROPRIOCEPTIVE
        self._arm = arm

    def reset(self, observation: Observation, seed: int) -> None:
        self._action = np.append(observation.joint_positions[: self._arm], OPEN).astype(np.float32)

    def act(self, observation: Observation) -> npt.NDArray[np.float32]:
        return self._action


def looking(robot_name: str, cameras: Sequence[str] | None = None, clouds: bool = True) -> ControllerSpec:
    """Return the specification of the controller :class:`Looking`, which only observes and does not move the arm."""
    named = None if cameras is None else list(cameras)
    arguments = {"arm": len(robot(robot_name).arm_joints), "cameras": named, "clouds": clouds}
    return ControllerSpec(f"{__name__}:Looking", arguments)

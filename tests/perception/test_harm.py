"""Wrong estimates do no harm: missing objects are refused, and the arm presses with a limited force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from gensim2.objects import RigidObject, open_library
from gensim2.perception.estimation import PerceivingChain, chain
from gensim2.perception.estimation.presence import connected_extent
from gensim2.robots import robot
from gensim2.robots.force import FORCE_LIMIT, Yielding
from gensim2.rollout.controller import PrivilegedObservation, spec_of
from gensim2.rollout.record import Cause
from gensim2.rollout.run import run
from gensim2.scenes.initial_state import InitialState, PlacedObject
from gensim2.scenes.randomize import placed
from gensim2.sim.headless import HeadlessEnv
from gensim2.tasks.library import load_task
from gensim2.tasks.spec import ObjectSpec

Array = npt.NDArray[np.float64]
PANDA = robot("panda")
Q = np.array(PANDA.reset_qpos)
ARM = list(PANDA.arm_columns)


class MeasuredForce(HeadlessEnv):
    """Measures the contact force on the robot, averaged over each control step, N."""

    def reset(self, seed: int, options: object = None, *, robot: bool = True) -> None:
        super().reset(seed, robot=robot)
        if robot:
            self.forces: list[float] = []

    def _advance(self) -> None:
        found = []
        for _ in range(self.profile.substeps):
            self._scene.step()
            if self._scene.robot is not None:
                found.append(self._scene.pressing_force())
        self.elapsed_steps += 1
        if found:
            self.forces.append(float(np.mean(found)))


@pytest.mark.parametrize("is_limited", [True, False])
def test_a_door_is_closed_within_the_force_limit(monkeypatch: pytest.MonkeyPatch, is_limited: bool) -> None:
    """The push goes beyond the estimated end of the joint's range, so the door stops the arm."""
    most = 1.1 * chain.PRESSING
    if not is_limited:
        monkeypatch.setattr(chain, "PRESSING", 1e6)
    world = MeasuredForce("CloseRefrigeratorDoor", assets="builtin", engine="mujoco")
    assert run(world, PerceivingChain("CloseRefrigeratorDoor"), seed=3).episode.held
    # The largest force that lasts for three control steps. A collision of the moving arm is shorter.
    lasting = max(min(world.forces[at : at + 3]) for at in range(len(world.forces) - 2))
    assert (lasting <= most) == is_limited


def test_a_held_arm_presses_with_the_limit_and_ends_its_motion() -> None:
    """An obstacle holds the arm on its way to the object: the observed joints do not change."""
    env = HeadlessEnv("OpenBox", assets="builtin", engine="mujoco")
    env.reset(0)
    controller = PerceivingChain("OpenBox")
    seen = env.observe(spec_of(controller))
    controller.reset(seen, 0)
    q, yielding = env.q, Yielding(PANDA, FORCE_LIMIT)
    forces: list[float] = []
    for step in range(100):
        action = controller.act(replace(seen, step=step))
        assert action is not None
        forces.append(yielding.force(q, action[:-1].astype(np.float64)))
        if controller.events:
            break
    assert [event.what for event in controller.events] == [Cause.FORCE_LIMIT]
    # The force of the hand may be the one at its limit, and the force of the tool then is smaller.
    assert 0.9 < max(forces) / chain.PRESSING <= 1.001
    assert forces[-1] == pytest.approx(0.0, abs=0.1)  # The arm no longer presses.


@pytest.mark.parametrize("is_stopped", [True, False])
def test_the_hand_does_not_slip_over_a_toaster_that_blocks_it(
    monkeypatch: pytest.MonkeyPatch, is_stopped: bool
) -> None:
    """The cloud does not show how far a toaster can be pushed, so the plan leads beyond the end of its range."""
    if not is_stopped:
        monkeypatch.setattr(chain, "PRESSED_SECONDS", 1e6)
    world = HeadlessEnv("PushToasterForward", assets="builtin", engine="mujoco")
    controller = PerceivingChain("PushToasterForward")
    motions = []
    begin = chain._Chain._begin

    def noted(self: chain._Chain, observation: PrivilegedObservation) -> bool:
        found = begin(self, observation)
        motions.append(self._running)
        return found

    monkeypatch.setattr(chain._Chain, "_begin", noted)
    assert run(world, controller, seed=1).episode.held or not is_stopped
    first = motions[0]
    assert first is not None
    assert first.is_stopped == is_stopped


@pytest.mark.parametrize("failures", [chain.MAX_FRESH_STARTS, chain.MAX_FRESH_STARTS + 1])
def test_the_controller_looks_again_if_no_strategy_has_a_plan(monkeypatch: pytest.MonkeyPatch, failures: int) -> None:
    """The errors of the next point cloud differ, so a plan may exist then."""
    env = HeadlessEnv("OpenBox", assets="builtin", engine="mujoco")
    env.reset(0)
    controller = PerceivingChain("OpenBox")
    seen = env.observe(spec_of(controller))
    controller.reset(seen, 0)
    plans, calls = chain._Chain._begin, iter(range(100))

    def fails_first(self: chain._Chain, observation: PrivilegedObservation) -> bool:
        return next(calls) >= failures and plans(self, observation)

    monkeypatch.setattr(chain._Chain, "_begin", fails_first)
    for step in range(chain.MAX_FRESH_STARTS):
        action = controller.act(replace(seen, step=step))
        assert action is not None
        np.testing.assert_allclose(action[:-1], env.q[ARM], atol=1e-6)  # The arm stays where it is.
    last = controller.act(replace(seen, step=chain.MAX_FRESH_STARTS))
    assert len(controller.looks) == chain.MAX_FRESH_STARTS + 1
    assert (last is None) == (failures > chain.MAX_FRESH_STARTS)


@pytest.mark.parametrize("is_free", [True, False])
def test_limited_targets_press_with_the_limit(is_free: bool) -> None:
    """The force is the multiplier of the constraint that the tool stays where it is."""
    yielding = Yielding(PANDA, 50.0)
    asked = Q[ARM] + np.array([0.1, 0.3, -0.1, 0.2, 0.0, -0.3, 0.4])
    targets, short = yielding.targets(Q, np.zeros(len(Q)), asked, is_free=is_free)
    stiffness = np.diag([drive.stiffness for drive in PANDA.arm_drives])
    jacobian = PANDA.model.jacobian(Q, PANDA.tool_link)[:3, ARM]
    system = np.block([[stiffness, jacobian.T], [jacobian, np.zeros((3, 3))]])
    solved = np.linalg.solve(system, np.concatenate([stiffness @ (targets - Q[ARM]), np.zeros(3)]))
    force = float(np.linalg.norm(solved[-3:]))
    assert force == pytest.approx(yielding.force(Q, targets))
    assert 0.5 * 50.0 < force <= 50.0 + 1e-6  # The force on the hand may be the one at its limit.
    assert short == pytest.approx(float(np.linalg.norm(jacobian @ (asked - targets))))
    if is_free:
        share = (targets - Q[ARM])[[0, 1, 6]] / (asked - Q[ARM])[[0, 1, 6]]
        np.testing.assert_allclose(share, share[0])


def test_small_changes_of_the_targets_and_a_moving_arm_are_not_limited() -> None:
    yielding = Yielding(PANDA, 50.0)
    asked = Q[ARM] + 0.001
    targets, short = yielding.targets(Q, np.zeros(len(Q)), asked, is_free=True)
    assert short == 0.0
    np.testing.assert_array_equal(targets, asked)
    # An arm that moves as fast as its targets presses on nothing.
    velocity = np.zeros(len(Q))
    velocity[0] = 1.0
    asked = Q[ARM] + PANDA.lags * velocity[ARM]
    targets, short = yielding.targets(Q, velocity, asked, is_free=True)
    assert short == 0.0
    np.testing.assert_array_equal(targets, asked)


def test_the_extent_is_that_of_the_largest_connected_part() -> None:
    line = np.zeros((30, 3), dtype=np.float32)
    line[:, 0] = np.linspace(0.0, 0.3, 30)
    alone = line[:10] + np.float32(1.0)
    assert connected_extent(np.concatenate([line, alone])) == pytest.approx(0.3, abs=1e-6)
    assert connected_extent(line[:2]) == 0.0


@pytest.mark.parametrize("names", [("master_chef_can",), ("mug", "cracker_box", "apple")])
def test_rigid_objects_alone_are_refused(names: tuple[str, ...]) -> None:
    library, task = open_library("builtin"), load_task("CloseBox")
    objects: dict[str, PlacedObject] = {}
    for number, name in enumerate(names):
        model = library.load(name, "0")
        assert isinstance(model, RigidObject)
        at = np.array([0.0, 0.0, model.placement.position[2]])
        pose = placed(at, model.placement.quaternion, 0.05 * number, 0.15 * number, 0.3)
        objects[f"thing_{number}"] = PlacedObject(model, *pose, 0.3, None)
    shown = {name: ObjectSpec(asset_class=each.model.asset_class) for name, each in objects.items()}
    env = HeadlessEnv(task.model_copy(update={"objects": shown}), assets="builtin", engine="mujoco")
    env._drawn = (0, InitialState(objects, 1, PANDA.reset_qpos, "paper"))
    env.reset(0)
    controller = PerceivingChain(task)
    seen = env.observe(spec_of(controller))
    controller.reset(seen, 0)
    assert controller.act(seen) is None
    assert [event.what for event in controller.events] == [Cause.OBJECT_NOT_SEEN]
    assert controller.plans == []

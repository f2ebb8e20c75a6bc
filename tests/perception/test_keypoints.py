"""Clouds of keypoints and box corners: positions as in SAPIEN, a fixed order, and their description."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gensim2.core.errors import InputError
from gensim2.perception import CloudSettings, DepthNoise, Encoder, ObservationSpec
from gensim2.sim.headless import HeadlessEnv

SPEC = ObservationSpec.of({"points": 64, "source": "keypoints"})


def placed(T: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]


@pytest.mark.parametrize("task", ["TurnOnFaucet", "PlaceGolfBallIntoDrawer"])
def test_points_stand_where_the_simulator_has_them(task: str) -> None:
    env = HeadlessEnv(task, assets="builtin")
    env.reset(seed=4)
    for _ in range(3):
        env.step(env.profile.rest_action)
    cloud = env.observe(SPEC).cloud
    assert cloud is not None
    T_base_world = np.linalg.inv(env.profile.T_world_base)
    expected = []
    for part in env.parts.values():
        seen = part.scene_object(T_base_world)
        poses = {body.name.split("/")[-1]: body for body in seen.bodies}
        if seen.joint is None:
            (body,) = seen.bodies
            groups = [(body.T_base_body, [body])]
        else:
            moving = [body for body in seen.bodies if body.name in seen.joint.moves]
            still = [body for body in seen.bodies if body.name not in seen.joint.moves]
            root = T_base_world @ part.articulation.pose.to_transformation_matrix()
            groups = [(poses[part.model.joint.child_link].T_base_body, moving), (root, still)]
        for T, bodies in groups:
            vertices = np.concatenate([placed(body.T_base_body, hull) for body in bodies for hull in body.hulls])
            own = placed(np.linalg.inv(T), vertices)
            for x in (own[:, 0].min(), own[:, 0].max()):
                for y in (own[:, 1].min(), own[:, 1].max()):
                    expected += [placed(T, np.array([x, y, z])) for z in (own[:, 2].min(), own[:, 2].max())]
        points = part.keypoints()
        expected += [placed(T_base_world, np.asarray(points[name])) for name in sorted(points)]
    count = len(expected)
    assert 16 < count < SPEC.cloud.points
    assert np.abs(cloud.xyz[:count] - np.array(expected)).max() < 2e-4  # coordinates are rounded to 0.1 mm
    assert (cloud.xyz[count:] == cloud.xyz[: len(cloud.xyz) - count]).all()  # repeated from the start
    with pytest.raises(InputError, match=rf"points: is 8, but the objects have {count} .*at least {count}"):
        env.observe(ObservationSpec.of({"points": 8, "candidates": 64, "source": "keypoints"}))


def test_no_camera_gives_them() -> None:
    assert SPEC.is_privileged
    assert not SPEC.casts
    env = HeadlessEnv("CloseBox", assets="builtin")
    env.reset(seed=0)
    with pytest.raises(Exception, match="available in simulation only"):
        Encoder(SPEC, env.profile).encode(0, env.q, env.qvel, 1.0)
    with pytest.raises(InputError, match="noise: is of depth pictures"):
        replace(SPEC.cloud, noise=DepthNoise())


def test_what_sees_them_is_not_what_sees_clouds_of_pictures() -> None:
    pictures = ObservationSpec.of({"points": 64, "candidates": 4096})
    assert ObservationSpec.of(SPEC.to_dict()) == SPEC
    assert "source" not in pictures.to_dict()["cloud"]  # as in older files
    assert CloudSettings.of(pictures.cloud.to_dict()) == pictures.cloud
    for one, other in ((SPEC, pictures), (pictures, SPEC)):
        with pytest.raises(InputError, match=r"observation\.cloud\.source: "):
            one.require(other, "the data", of="the policy")

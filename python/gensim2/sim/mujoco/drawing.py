"""Draw recorded states with MuJoCo's renderer. The drawn model has only surfaces and no physics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from gensim2.core.arrays import Array
from gensim2.objects import ObjectModel
from gensim2.perception import Camera
from gensim2.perception.raycast.drawing import SKY
from gensim2.perception.raycast.scene import RaycastScene
from gensim2.perception.raycast.shapes import Surface, Texture
from gensim2.perception.raycast.state_drawing import StateDrawing
from gensim2.robots import RobotProfile
from gensim2.sim.driver import gl_context

Frame = npt.NDArray[np.uint8]

NEAR, FAR = 0.02, 100.0
"""Nearest and farthest visible distance, m."""
SHADOW_PIXELS, SAMPLES = 2048, 4
"""Width of the shadow map in pixels, and number of samples of each pixel."""
SHADOW_RANGE = 1.2
"""Half side (m) of the area in which the lamp casts shadows."""
LARGEST_SHADOW = 4.0
"""Surfaces larger than this (m) are slightly transparent. Therefore they have no shadows, which would have speckles."""
AMBIENT = 0.42
LAMPS = (((0.5, -0.8, -1.3), 0.62, True), ((-0.6, 0.5, -1.0), 0.28, False))
"""Direction in the base frame, brightness and whether the lamp casts shadows, like the lamps of SAPIEN's renderer.

Without a GPU a frame takes 0.2 s of CPU time, and 0.1 s without shadows.
"""
LAMP_DISTANCE = 2.0
"""Distance of a lamp from the workspace, m; only the shadow map depends on this distance."""


class SceneRenderer:
    """Renders the solids of a ray-casting scene with MuJoCo, through EGL or OSMesa.

    Args:
        scene: scene with at least one camera.

    Raises:
        GenSim2Error: neither EGL nor OSMesa works.
    """

    def __init__(self, scene: RaycastScene) -> None:
        self._scene = scene
        width, height = (max(getattr(camera, side) for camera in scene.cameras) for side in ("width", "height"))
        self._context = gl_context(width, height)
        self._model = _model(scene, width, height)
        self._data = mujoco.MjData(self._model)
        self._view, self._option = mujoco.MjvScene(self._model, maxgeom=self._model.ngeom + 16), mujoco.MjvOption()
        self._camera = mujoco.MjvCamera()
        self._camera.type = mujoco.mjtCamera.mjCAMERA_FIXED
        with self._context.as_current():
            self._renderer = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
            mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._renderer)

    def see(self, poses: Array, links: Mapping[str, Array] | None = None) -> tuple[Frame, ...]:
        """Return the colour image (H, W, 3) of each camera.

        Args:
            poses: (L, 4, 4) poses of the solids in the base frame.
            links: (4, 4) pose of each link with cameras, in the base frame.
        """
        data, model = self._data, self._model
        cameras = [
            camera.T_base_camera if camera.link is None else (links or {})[camera.link] @ camera.T_base_camera
            for camera in self._scene.cameras
        ]
        for number, T in enumerate([*poses, *cameras]):
            data.mocap_pos[number] = T[:3, 3]
            mujoco.mju_mat2Quat(data.mocap_quat[number], np.ascontiguousarray(T[:3, :3]).ravel())
        mujoco.mj_kinematics(model, data)
        mujoco.mj_camlight(model, data)
        return tuple(self._picture(number, camera) for number, camera in enumerate(self._scene.cameras))

    def _picture(self, number: int, camera: Camera) -> Frame:
        self._camera.fixedcamid = number
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL.value, self._view
        )
        picture = np.empty((camera.height, camera.width, 3), np.uint8)
        place = mujoco.MjrRect(0, 0, camera.width, camera.height)
        with self._context.as_current():
            mujoco.mjr_render(place, self._view, self._renderer)
            mujoco.mjr_readPixels(picture, None, place, self._renderer)
        return np.ascontiguousarray(picture[::-1])

    def close(self) -> None:
        """Free the graphics memory."""
        with self._context.as_current():
            self._renderer.free()
        self._context.free()


class MujocoDrawing(StateDrawing):
    """Object that draws states with MuJoCo as the video camera sees them.

    The constructor is the one of :class:`StateDrawing`.
    """

    def __init__(self, profile: RobotProfile, objects: Mapping[str, ObjectModel]) -> None:
        super().__init__(profile, objects)
        self._renderer = SceneRenderer(self._scene)

    def of(self, state: Mapping[str, Any]) -> Frame:
        (picture,) = self._renderer.see(self._scene.poses(state)[0])
        return picture

    def close(self) -> None:
        self._renderer.close()


def _model(scene: RaycastScene, width: int, height: int) -> mujoco.MjModel:
    """Compile a model for drawing.

    The model has a mocap body for each solid of the scene, and then one for each camera.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.stat.extent, spec.stat.center = 1.0, (0.5, 0.0, 0.0)
    visual = spec.visual
    visual.map.znear, visual.map.zfar = NEAR, FAR
    visual.global_.offwidth, visual.global_.offheight = width, height
    visual.quality.shadowsize, visual.quality.offsamples = SHADOW_PIXELS, SAMPLES
    visual.headlight.ambient, visual.headlight.diffuse = np.full(3, AMBIENT), np.zeros(3)
    visual.headlight.specular = np.zeros(3)
    visual.map.shadowclip = SHADOW_RANGE
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        rgb1=np.array(SKY) / 255.0,
        rgb2=np.array(SKY) / 255.0,
        width=16,
        height=16 * 6,
    )
    for direction, brightness, shadow in LAMPS:
        towards = np.array(direction) / np.linalg.norm(direction)
        spec.worldbody.add_light(
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            pos=np.array([0.5, 0.0, 0.2]) - LAMP_DISTANCE * towards,
            dir=towards,
            diffuse=np.full(3, brightness),
            ambient=np.zeros(3),
            specular=np.full(3, 0.15),
            castshadow=shadow,
        )
    for number, solid in enumerate(scene.solids):
        body = spec.worldbody.add_body(name=f"solid_{number}", mocap=True)
        _add_surface(spec, body, f"solid_{number}", solid.surface)
    for number, camera in enumerate(scene.cameras):
        body = spec.worldbody.add_body(name=f"camera_{number}", mocap=True)
        K = camera.intrinsic
        body.add_camera(
            quat=(0.0, 1.0, 0.0, 0.0),  # MuJoCo's cameras look along -z
            resolution=(camera.width, camera.height),
            focal_pixel=(K[0, 0], K[1, 1]),
            principal_pixel=(K[0, 2] - camera.width / 2, camera.height / 2 - K[1, 2]),
            sensor_size=(camera.width / 1000.0, camera.height / 1000.0),
        )
    return spec.compile()


def _add_surface(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, surface: Surface) -> None:
    """Add a mesh for each colour and for each texture of a surface."""
    corners = surface.vertices[surface.faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    plain = area > 1e-14
    for number, texture in enumerate(surface.textures):
        plain[texture.faces] = False
        chosen = area[texture.faces] > 1e-14
        _add_mesh(spec, body, f"{name}_texture_{number}", surface, texture.faces[chosen], texture, chosen)
    faces = np.flatnonzero(plain)
    colors, group = np.unique(surface.colors[faces], axis=0, return_inverse=True)
    for number, color in enumerate(colors):
        chosen = faces[group.ravel() == number]
        geom = _add_mesh(spec, body, f"{name}_color_{number}", surface, chosen)
        if geom is not None:
            is_floor = np.ptp(surface.vertices[surface.faces[chosen].ravel()], axis=0).max() > LARGEST_SHADOW
            geom.rgba = [*(color / 255.0), 0.99 if is_floor else 1.0]


def _add_mesh(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    name: str,
    surface: Surface,
    faces: npt.NDArray[np.integer],
    texture: Texture | None = None,
    rows: npt.NDArray[np.bool_] | None = None,
) -> mujoco.MjsGeom | None:
    if not len(faces):
        return None
    used, index = np.unique(surface.faces[faces], return_inverse=True)
    mesh = spec.add_mesh(
        name=name,
        uservert=surface.vertices[used].ravel(),
        userface=index.ravel().astype(np.int32),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    geom = body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, contype=0, conaffinity=0, rgba=(1, 1, 1, 1)
    )
    if texture is not None:
        uv = texture.corners[rows].reshape(-1, 2).astype(np.float32)
        uv[:, 1] = 1.0 - uv[:, 1]  # in MuJoCo the texture coordinate v increases downwards in the image
        mesh.usertexcoord = uv.ravel()
        mesh.userfacetexcoord = np.arange(len(uv), dtype=np.int32)
        image = np.ascontiguousarray(texture.image)
        height, width = image.shape[:2]
        picture = spec.add_texture(
            name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, height=height, width=width, nchannel=3
        )
        picture.data = image.tobytes()
        material = spec.add_material(name=name)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
        geom.material = name
    return geom

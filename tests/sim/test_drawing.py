"""MuJoCo's renderer: which renderer draws and why, and pictures that agree with the ray caster's."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

pytest.importorskip("mujoco")

import gensim2
from gensim2.core.errors import GenSim2Error
from gensim2.data.video import Replay, film
from gensim2.perception import Camera
from gensim2.perception.raycast.caster import CastSolid
from gensim2.perception.raycast.shapes import Surface, Texture
from gensim2.perception.raycast.state_drawing import StateDrawing
from gensim2.scenes.config import SceneOptions
from gensim2.sim import driver
from gensim2.sim.drawing import state_drawing
from gensim2.sim.headless import HeadlessEnv

GIVEN: dict[str, Any] = {"assets": "builtin", "engine": "mujoco"}


@pytest.fixture
def fresh() -> Any:
    """Forget which renderers work, before and after the test."""
    driver.renderer.cache_clear()
    yield
    driver.renderer.cache_clear()


def reason(monkeypatch: pytest.MonkeyPatch, *, packages: bool = True, libraries: tuple[str, ...] = ()) -> str:
    """Return which renderer draws for MuJoCo, if only the given system libraries are installed."""

    def load(name: str) -> None:
        if name not in libraries:
            raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(driver, "find_spec", lambda name: name == "mujoco" or packages or None)
    monkeypatch.setattr(driver.ctypes, "CDLL", load)
    found = driver.renderer("mujoco")
    assert found.name == "ray caster"
    return found.reason


def test_the_reason_names_what_is_missing(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    assert "PyOpenGL is not installed (pip install 'gensim2[render]')" in reason(monkeypatch, packages=False)
    driver.renderer.cache_clear()
    assert "neither EGL nor OSMesa is installed" in reason(monkeypatch)
    driver.renderer.cache_clear()
    monkeypatch.setenv("MUJOCO_GL", "glfw")
    assert "MUJOCO_GL: is 'glfw' (set it to egl or osmesa)" in reason(monkeypatch)


def test_a_driver_that_fails_is_named(fresh: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(name: str) -> None:
        raise ImportError("Cannot initialize a EGL device display.\nThis likely means")

    monkeypatch.setattr(driver, "import_module", fails)
    said = reason(monkeypatch, libraries=("libEGL.so.1",))
    assert said.endswith("because no EGL driver works: Cannot initialize a EGL device display. This likely means")
    with pytest.raises(GenSim2Error, match="no EGL driver works"):
        driver.gl_context(1, 1)


def test_osmesa_is_used_without_egl(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    asked = []
    monkeypatch.setattr(driver, "find_spec", lambda name: True)
    monkeypatch.setattr(driver, "import_module", lambda name: asked.append(name) or pytest.fail("stop"))
    for installed, module in (
        (("libOSMesa.so.8",), "mujoco.osmesa"),
        (("libEGL.so.1", "libOSMesa.so.8"), "mujoco.egl"),
    ):
        with pytest.raises((GenSim2Error, pytest.fail.Exception)):
            reason(monkeypatch, libraries=installed)
        driver.renderer.cache_clear()
        assert asked.pop() == module


renders = pytest.mark.skipif(driver.renderer("mujoco").name != "mujoco", reason="neither EGL nor OSMesa works here")


def stood(task: str, seed: int = 7) -> tuple[HeadlessEnv, dict[str, Any], dict[str, Any]]:
    """Return an environment after a reset, its objects, and its state."""
    env = HeadlessEnv(task, **GIVEN)
    env.reset(seed)
    models = {name: thing.model for name, thing in env.initial_state.objects.items()}
    return env, models, {kind: {n: row[None] for n, row in group.items()} for kind, group in env.state().items()}


@renders
@pytest.mark.parametrize("task", ["OpenDrawer", "FillMugWithWater"])
def test_pictures_agree_with_the_ray_caster(task: str) -> None:
    env, models, state = stood(task)
    drawn = state_drawing("mujoco", env.profile, models)
    assert type(drawn).__name__ == "MujocoDrawing"
    picture, cast = drawn.of(state), StateDrawing(env.profile, models).of(state)
    drawn.close()
    assert (picture.shape, picture.dtype) == (cast.shape, np.uint8)
    # Hues do not depend on the lamps: where the ray caster sees saturated colours, both pictures agree.
    hues = [_hue(each) for each in (picture, cast)]
    vivid = np.ptp(cast.astype(int), axis=2) > 60
    assert vivid.mean() > 0.05
    assert np.median(np.abs(hues[0] - hues[1])[vivid]) < 0.03
    assert np.mean(np.abs(hues[0] - hues[1]).max(axis=2)[vivid] > 0.1) < 0.02


def _hue(picture: npt.NDArray[np.uint8]) -> npt.NDArray[np.float64]:
    """Return the colours (H, W, 3) divided by their brightness."""
    return picture / picture.sum(axis=2, keepdims=True).clip(min=1)


class OneSolid:
    """A scene with one textured square in front of one camera."""

    def __init__(self) -> None:
        image = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 0]]], np.uint8).repeat(8, 0).repeat(8, 1)
        square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
        faces = np.array([[0, 1, 2], [0, 2, 3]], np.int32)
        corners = (square[faces][:, :, :2] + 1) / 2
        surface = Surface(square, faces, np.full((2, 3), 255, np.uint8), (Texture(image, np.arange(2), corners),))
        self.solids = (CastSolid(1, surface, True),)
        self.cameras = (Camera.looking("above", (0.0, -0.001, 3.0), (0.0, 0.0, 0.0), width=64, height=48, fov=0.9),)


@renders
def test_a_texture_lies_on_its_surface() -> None:
    from gensim2.sim.mujoco.drawing import SceneRenderer

    renderer = SceneRenderer(OneSolid())  # type: ignore[arg-type]
    (picture,) = renderer.see(np.eye(4)[None])
    renderer.close()
    strongest = [picture[row, column] > 100 for row in (15, 33) for column in (23, 41)]
    assert np.array(strongest).tolist() == [
        [True, False, False],
        [False, True, False],
        [False, False, True],
        [True, True, False],
    ]
    right = np.eye(4)
    right[0, 3] = 1.0
    (moved,) = SceneRenderer(OneSolid()).see(right[None])  # type: ignore[arg-type]
    columns = [np.flatnonzero((np.ptp(each.astype(int), axis=2) > 100).any(axis=0)) for each in (picture, moved)]
    # One metre at 3 m is 24 / tan(0.45) / 3 pixels.
    assert columns[1].min() - columns[0].min() == pytest.approx(24 / np.tan(0.45) / 3, abs=1.0)


@renders
def test_pictures_do_not_change_the_physics() -> None:
    found = []
    for render_mode in (None, "rgb_array"):
        env = gensim2.make_env("CloseBox", render_mode=render_mode, **GIVEN)
        _, info = env.reset(seed=3)
        assert ("renderer" in info) == (render_mode is not None)
        draw, states = np.random.default_rng(0), []
        for _ in range(10):
            env.step(draw.uniform(-1, 1, 8).astype(np.float32))
            env.render()
            states.append(env.unwrapped.headless.snapshot().physics.tobytes())  # type: ignore[attr-defined]
        env.close()
        found.append(states)
    assert found[0] == found[1]


@renders
def test_several_threads_can_render() -> None:
    env, models, state = stood("CloseBox")
    drawn = state_drawing("mujoco", env.profile, models)
    first = drawn.of(state)
    with ThreadPoolExecutor(3) as pool:
        pictures = [future.result() for future in [pool.submit(drawn.of, state) for _ in range(1)]]
        others = list(pool.map(lambda _: state_drawing("mujoco", env.profile, models).of(state), range(3)))
    assert all(np.array_equal(first, each) for each in [*pictures, *others])
    drawn.close()


@renders
def test_a_film_shows_the_states_that_mujoco_recorded(tmp_path: Path) -> None:
    import imageio.v2 as imageio

    env, models, _ = stood("CloseBox")
    states, actions = [env.state()], []
    for _ in range(8):
        actions.append(np.array([*np.add(env.initial_state.start[:7], 0.2), 1.0], np.float32))
        env.step(actions[-1])
        states.append(env.state())
    rows = {
        kind: {name: np.stack([each[kind][name] for each in states]) for name in states[0][kind]} for kind in states[0]
    }
    options = {"instance": {name: model.id for name, model in models.items()}}
    scene = SceneOptions.of(assets="builtin", engine="mujoco").with_task(env.task)
    replay = Replay("", {}, {"seed": 7, "options": options}, np.stack(actions), scene, rows)
    made = film(replay, tmp_path / "film.mp4", still=tmp_path / "still.png", stride=4)
    assert (made.frames, made.success) == (3, None)
    assert made.renderer.startswith("MuJoCo's renderer draws with ")
    frames = [np.asarray(frame, int) for frame in imageio.get_reader(tmp_path / "film.mp4")]
    assert frames[0].shape == (480, 640, 3)
    assert np.abs(frames[0] - frames[-1]).max() > 30  # the arm has moved

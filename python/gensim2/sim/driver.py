"""Select the renderer of pictures and films; importing this module does not import a simulator."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any, Literal

from gensim2.core.errors import GenSim2Error, InputError
from gensim2.scenes.physics import Engine

NO_DRIVER = (
    "no Vulkan driver that SAPIEN can use was found, so no pictures can be made "
    "(on Debian or Ubuntu install mesa-vulkan-drivers 24.3 or newer)"
)

GL_LIBRARIES: Mapping[str, str] = {"egl": "libEGL.so.1", "osmesa": "libOSMesa.so.8"}
"""System library of each OpenGL platform without a display, in order of preference."""


@dataclass(frozen=True)
class Renderer:
    """The renderer that draws pictures and films of an engine's episodes.

    Attributes:
        name: ``"sapien"``, ``"mujoco"`` or ``"ray caster"``.
        reason: sentence that tells the user why this renderer was selected.
    """

    name: Literal["sapien", "mujoco", "ray caster"]
    reason: str


@cache
def renderer(engine: Engine) -> Renderer:
    """Return the renderer of the engine, or the ray caster if the engine's renderer does not work in this process."""
    if engine == "sapien":
        if can_render():
            return Renderer("sapien", "SAPIEN's renderer draws")
        cause = "is not installed" if find_spec("sapien") is None else "finds no Vulkan driver"
        return Renderer("ray caster", f"the ray caster draws, because SAPIEN {cause}")
    try:
        gl_context(1, 1).free()
    except GenSim2Error as error:
        return Renderer("ray caster", f"the ray caster draws, because {error}")
    return Renderer("mujoco", f"MuJoCo's renderer draws with {_platform().upper()}")


@cache
def can_render() -> bool:
    """Return whether SAPIEN is installed and a Vulkan driver works in this process.

    ``sapien.Device("cpu")`` also succeeds without a driver, so this function creates an object that needs one. The
    first call takes less than 0.1 s and 80 MB.
    """
    if find_spec("sapien") is None:
        return False
    import sapien

    sapien.render.set_log_level("off")
    try:
        sapien.render.RenderMaterial()
    except RuntimeError:
        return False
    finally:
        sapien.render.set_log_level(os.getenv("MS_RENDERER_LOG_LEVEL", "warn"))
    return True


def gl_context(width: int, height: int) -> Any:
    """Return an OpenGL context without a display for MuJoCo's renderer, through EGL or OSMesa.

    MuJoCo's environment variable ``MUJOCO_GL`` selects ``egl`` or ``osmesa``. The default is EGL if it is installed.

    Args:
        width, height: largest size of a picture, pixels.

    Raises:
        GenSim2Error: PyOpenGL, a library or a driver is missing.
        InputError: ``MUJOCO_GL`` has another value.
    """
    if find_spec("mujoco") is None:
        raise GenSim2Error("MuJoCo is not installed (pip install 'gensim2[mujoco]')")
    if find_spec("OpenGL") is None:
        raise GenSim2Error("PyOpenGL is not installed (pip install 'gensim2[render]')")
    platform = _platform()
    try:
        context: Any = import_module(f"mujoco.{platform}").GLContext(width, height)
    except Exception as error:
        raise GenSim2Error(f"no {platform.upper()} driver works: {_line(error)}") from error
    return context


def _platform() -> str:
    """Return the OpenGL platform that the user chose, or the first one whose library is installed."""
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    if chosen in GL_LIBRARIES:
        return chosen
    if chosen:
        raise InputError(f"is {chosen!r}", field="MUJOCO_GL", remedy=f"set it to {' or '.join(GL_LIBRARIES)}")
    for platform, library in GL_LIBRARIES.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        return platform
    raise GenSim2Error("neither EGL nor OSMesa is installed (on Debian or Ubuntu: apt-get install libegl1)")


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__

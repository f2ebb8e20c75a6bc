"""Test whether SAPIEN can render on this machine; importing this module does not import a simulator."""

from __future__ import annotations

import os
from functools import cache
from importlib.util import find_spec

NO_DRIVER = (
    "no Vulkan driver that SAPIEN can use was found, so no pictures can be made "
    "(on Debian or Ubuntu install mesa-vulkan-drivers 24.3 or newer)"
)


@cache
def can_render() -> bool:
    """Return whether SAPIEN is installed and a Vulkan driver works in this process.

    ``sapien.Device("cpu")`` works without a driver, so this function creates an object that needs a driver. It takes
    less than 0.1 s and about 80 MB, once in each process.
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

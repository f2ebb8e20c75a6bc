"""The program inside the sandbox: ``python -I -S -B main.py``. Reads one JSON document, writes one, needs Python only.

First it gives up everything that it does not need: limits, then a seccomp filter after which no file can be opened, no
process started and no signal be sent. Only then it looks at the program that it was given, and runs it.
"""

import ast  # noqa: F401 - imported now: later no file can be opened
import base64
import ctypes
import json
import os
import resource
import sys
import types
import unicodedata  # noqa: F401 - Python spells identifiers beyond ASCII with it, and names characters
from typing import Any

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))  # noqa: PTH100, PTH120 - pathlib takes 10 ms

import allow_list  # type: ignore[import-not-found]
import task_code  # type: ignore[import-not-found]

PR_SET_PDEATHSIG, PR_SET_SECCOMP, PR_SET_NO_NEW_PRIVS = 1, 22, 38
SECCOMP_MODE_FILTER, SIGKILL = 2, 9
BYTES_PER_INSTRUCTION = 8

LONGEST_MESSAGE = 500

FILE = "<task>"
"""Name of the program in its own tracebacks."""


class Program(ctypes.Structure):
    """``struct sock_fprog`` of linux/filter.h."""

    _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_char_p))


def lock(limits: dict[str, int], instructions: bytes) -> None:
    """Give up for good what is not needed.

    Args:
        limits: by the names of :mod:`resource`.
        instructions: of the filter.

    Raises:
        OSError: the kernel has no such filter.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl.argtypes = (ctypes.c_int, *(ctypes.c_ulong,) * 4)
    prepared = Program(len(instructions) // BYTES_PER_INSTRUCTION, instructions)
    for name, value in limits.items():
        resource.setrlimit(getattr(resource, name), (value, value))
    for arguments in (
        (PR_SET_PDEATHSIG, SIGKILL, 0, 0, 0),
        (PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0),
        (PR_SET_SECCOMP, SECCOMP_MODE_FILTER, ctypes.addressof(prepared), 0, 0),
    ):
        if libc.prctl(*arguments) != 0:
            raise OSError(ctypes.get_errno(), "prctl")


def answer(source: str, checked: bool) -> dict[str, Any]:
    """Return the result of a program as plain data: ``task``, or ``kind`` and ``problems``."""
    lines = source.splitlines()
    try:
        if checked:
            found = allow_list.problems(source, task_code.__all__, task_code.METHODS)
            if found:
                return {"kind": "refused", "problems": [f"line {line}: {words}" for line, words in found]}
        code = compile(source, FILE, "exec", dont_inherit=True)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        line = getattr(error, "lineno", None)
        words = getattr(error, "msg", None) or str(error) or type(error).__name__
        return {"kind": "syntax", "problems": [f"line {line}: {words}" if line else words]}
    module = types.ModuleType("task")
    try:
        exec(code, module.__dict__)
        return {"task": task_code.fields_of(the_class(module)())}
    except BaseException as error:  # noqa: BLE001 - whatever a program raises is its answer
        return {"kind": "failed", "problems": [told(error, lines)]}


def the_class(module: types.ModuleType) -> type[Any]:
    """The class that the program is about.

    Raises:
        ValueError: there is none.
    """
    for value in reversed(list(vars(module).values())):
        if isinstance(value, type) and issubclass(value, task_code.Task) and value is not task_code.Task:
            return value
    raise ValueError("there is no class derived from Task")


def told(error: BaseException, lines: list[str]) -> str:
    """An exception with the line of the program that it comes from."""
    number, trace = None, error.__traceback__
    while trace is not None:  # not by the module traceback, which would look for the program's file
        if trace.tb_frame.f_code.co_filename == FILE:
            number = trace.tb_lineno
        trace = trace.tb_next
    where = f"line {number}: " if number is not None and number <= len(lines) else ""
    return f"{where}{type(error).__name__}: {str(error)[:LONGEST_MESSAGE]}"


def written(source: str, checked: bool) -> bytes:
    """The answer as JSON; whatever goes wrong on the way, there is one."""
    try:
        return json.dumps(answer(source, checked)).encode()
    except BaseException as error:  # noqa: BLE001 - a number that cannot be written, a tree too deep, no memory
        return json.dumps({"kind": "failed", "problems": [told(error, source.splitlines())]}).encode()


def main() -> None:
    given = json.load(sys.stdin)
    task_code.add_criteria(vars(task_code), given["criteria"])
    lock(given["limits"], base64.b64decode(given["filter"]))
    data = written(given["source"], given["checked"])
    while data:
        data = data[os.write(1, data) :]
    os._exit(0)  # what the program left to be done at the end is not done


if __name__ == "__main__":
    main()

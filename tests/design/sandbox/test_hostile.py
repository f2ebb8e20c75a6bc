"""Hostile programs: refused by the allow-list, and harmless in the interpreter even without it."""

from __future__ import annotations

import ast
import sys
import threading
import time
from collections.abc import Iterator

import pytest

from gensim2.design.sandbox import TaskCodeError, run_task_code
from gensim2.design.sandbox.allow_list import Refused
from gensim2.design.sandbox.interpreter import interpret

HEAD = """from task_code import Object, Task, articulated_open
class Odd(Task):
    description = "open it"
    def __init__(self):
        self.thing = Object("drawer")
"""
LINE = HEAD.count("\n") + 1
#: Seconds that these programs may take on a busy machine.
LONGEST_S = 20.0

#: Programs by name: the source, a part of the error message, and the line number in it.
PROGRAMS: dict[str, tuple[str, str, int]] = {
    # Files, network, processes
    "write a file": ("open('/tmp/new', 'w').write('x')", "call of .'write'", 1),
    "read a secret": ("raise ValueError(open('/etc/passwd').read())", "a raise", 1),
    "delete a file": ("import os\nos.remove('/tmp/x')", "import 'os'", 1),
    "rename a file": ("from os import rename\nrename('a', 'b')", "imports from 'os'", 1),
    "make a folder": ("__import__('os').mkdir('/tmp/deep')", "call of .'mkdir'", 1),
    "raw system calls": ("import ctypes\nctypes.CDLL(None).fork()", "'ctypes'", 1),
    "rewrite the language itself": ("import task_code\nopen(task_code.__file__, 'a')", "import 'task_code'", 1),
    "fetch a page": ("import urllib.request as r\nr.urlopen('http://127.0.0.1')", "'urllib.request'", 1),
    "fork bomb": ("import os\nwhile True: os.fork()", "a while", 2),
    "run a shell": (HEAD + "        x = os.system('touch /tmp/owned')\n", "call of .'system'", LINE),
    "a signal to its parent": ("import os\nos.kill(1, 10)", "'os'", 1),
    # Escapes from the language
    "from a tuple to everything": (
        HEAD + "        x = ().__class__.__base__\n",
        "'__base__' is not allowed, because only attributes of self",
        LINE,
    ),
    "subclasses": ("for c in ().__class__.__subclasses__(): pass", "'__subclasses__'", 1),
    "a dunder of self": (HEAD + "        x = self.__dict__\n", "self.'__dict__' is not allowed", LINE),
    "a dunder assigned": (HEAD + "        self.__class__ = Object\n", "self.'__class__' is not allowed", LINE),
    "a dunder of the class": (HEAD + "        __slots__ = 1\n", "the name '__slots__' cannot be assigned", LINE),
    "globals of a method": (
        HEAD + "        x = self.step.__globals__\n",
        "'__globals__' is not allowed, because only attributes of self",
        LINE,
    ),
    "by a format": (HEAD + "        x = '{0.__init__}'.format(self)\n", "call of .'format'", LINE),
    "by a name": (HEAD + "        x = __builtins__\n", "the name '__builtins__' is not allowed", LINE),
    "by builtins": ("__builtins__['eval']('1')", "only a function given by its name", 1),
    "by super": (HEAD + "        x = super().__setattr__('a', 1)\n", "super().__init__() only", LINE),
    "by a method that is replaced": (HEAD + "        self.step = Object\n", "self.step cannot be assigned", LINE),
    "by a name that is replaced": (HEAD + "        self = Object\n", "the name 'self' cannot be assigned", LINE),
    "by a decorator": ("@print\nclass A: pass", "a decorator", 2),
    "by a metaclass": ("class A(metaclass=print): pass", "derived from Task", 1),
    "by letters that look alike": ("ｅｘｅｃ('import os')", "'exec'", 1),
    "by a lambda in a default": ("def f(x=(lambda: open('a', 'w'))()): pass", "a function", 1),
    "by an annotation": (HEAD + "        x: eval('1') = 1\n", "an assignment with a type", LINE),
    "by a match": (HEAD + "        match self:\n            case Object(): pass\n", "a match", LINE),
    "by an index": (HEAD + "        x = [1][0]\n", "an index", LINE),
    "by an assignment in an expression": (HEAD + "        self.step(a := 'x', self.thing)\n", "inside an expr", LINE),
    "by arguments in a dict": (HEAD + "        self.step(**{'name': 'x'})\n", "** in a call", LINE),
    "by a type as a value": (
        HEAD + "        self.step('a', Object)\n",
        "a task cannot contain a value of type type",
        0,
    ),
    "by a method as a value": (
        HEAD + "        self.step('a', self.step)\n",
        "a value of type method",
        0,
    ),
    # Time and memory
    "endless loop": ("while True: pass", "a while", 1),
    "memory bomb": ("x = ['x' * 2**20 for _ in iter(int, 1)]", "assignment outside", 1),
    "a number without end": (HEAD + "        x = 9 ** 9 ** 9\n", "the operator Pow", LINE),
    "a shift": (HEAD + "        x = 1 << 99999999\n", "the operator LShift", LINE),
    "a huge text": (HEAD + "        self.description = 'x' * 10**8\n", "arithmetic is allowed with numbers only", LINE),
    "a huge list": (HEAD + "        x = [1] * 10**8\n", "arithmetic is allowed with numbers only", LINE),
    "a long program": (HEAD + "        self.goal()\n" * 8_000, "more than 100000", 0),
    "many parts": (HEAD + "        self.goal(1)\n" * 1_000, "more than 5000 syntax nodes", 1),
    "a deep expression": ("x = " + "-" * 50_000 + "1", "cannot be parsed", 1),
    "a deep sum": (HEAD + "        x = 1" + " + 1" * 200 + "\n", "nested too deeply", LINE),
    "deep attributes": (HEAD + "        x = self" + ".a" * 5_000 + "\n", "nested too deeply", LINE),
    "deep calls": (HEAD + "        x = Object" + "()" * 400 + "\n", "nested too deeply", LINE),
    "deep brackets": ("x = " + "(" * 40_000 + ")" * 40_000, "too many nested parentheses", 1),
    "deep lists": (HEAD + "        x = " + "[" * 60 + "]" * 60 + "\n", "nested too deeply", LINE),
    "a list that holds another many times": (
        HEAD
        + "        a = [1, 2]\n"
        + "        a = [a, a, a, a, a, a, a, a, a, a]\n" * 20
        + "        self.step('a', self.thing, done=a)\n",
        "contains more than 100000 values",
        0,
    ),
    "a list in a list in a list": (
        HEAD + "        a = 1\n" + "        a = [a]\n" * 500 + "        self.goal(a)\n",
        "values are nested too deeply",
        0,
    ),
    "a long text many times": (
        HEAD + f"        a = '{'x' * 90_000}'\n" + "        self.goal(a, a, a, a, a)\n" * 10,
        "contains more than 100000 values",
        0,
    ),
    "a long name": (HEAD + f"        self.step({'a' * 90_000}=1)\n", "TypeError: Task.step() got", LINE),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_is_refused_by_name_and_line_in_bounded_time(name: str) -> None:
    source, words, line = PROGRAMS[name]
    begin = time.monotonic()
    with pytest.raises(TaskCodeError) as caught:
        run_task_code(source)
    assert time.monotonic() - begin < LONGEST_S
    where = f"line {line}: " if line else ""
    assert any(each.startswith(where) and words in each for each in caught.value.problems), caught.value.problems
    assert len(str(caught.value)) < 10_000


def test_a_program_is_read_in_a_thread_with_a_small_stack() -> None:
    """Designers read programs in worker threads, which have small stacks."""
    found: list[str] = []

    def read() -> None:
        for source, _, _ in PROGRAMS.values():
            with pytest.raises(TaskCodeError):
                run_task_code(source)
        found.append("all")

    before = threading.stack_size(2 * 2**20)
    try:
        thread = threading.Thread(target=read)
        thread.start()
        thread.join()
    finally:
        threading.stack_size(before)
    assert found == ["all"]


_events: list[str] | None = None


def _note(event: str, _: object) -> None:
    if _events is not None:
        _events.append(event)


@pytest.fixture
def events() -> Iterator[list[str]]:
    """Names of the audit events during a test: files, imports, processes, sockets, compiled code."""
    global _events
    if _note not in _hooks:
        sys.addaudithook(_note)
        _hooks.append(_note)
    _events = []
    yield _events
    _events = None


_hooks: list[object] = []


@pytest.mark.parametrize("name", PROGRAMS)
def test_the_interpreter_alone_does_nothing_but_make_values(name: str, events: list[str]) -> None:
    """Without the allow-list, each construct ends the program or makes values of the language."""
    try:
        tree = ast.parse(PROGRAMS[name][0])
    except (SyntaxError, RecursionError, MemoryError):
        return  # there is no program
    events.clear()
    try:
        fields = interpret(tree)
    except (Refused, TaskCodeError, RecursionError):
        fields = {}
    assert events == []
    assert all(type(value) in (str, int, list, dict) for value in fields.values())


def test_the_witness_notices(events: list[str]) -> None:
    exec("import ctypes.util; open('/dev/null').close()")
    assert {"exec", "open"} <= set(events)

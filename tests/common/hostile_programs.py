"""Programs that a model might write, by chance or because it was told to: none may do anything outside the box.

``{secret}`` stands for a file, ``{folder}`` for its folder, ``{port}`` for a TCP port that a server listens on and
``{parent}`` for the process that runs the tests. What a program gets hold of it raises, so that its answer shows it.
"""

from __future__ import annotations

from dataclasses import dataclass

_RAW = "import ctypes\nlibc = ctypes.CDLL(None, use_errno=True)\n"
_CONNECT = """
import ctypes
libc = ctypes.CDLL(None)
fd = libc.socket(2, 1, 0)
address = b"\\x02\\x00" + ({port}).to_bytes(2, "big") + bytes([127, 0, 0, 1]) + bytes(8)
libc.connect(fd, address, 16)
libc.write(fd, b"hello", 5)
"""


@dataclass(frozen=True)
class Hostile:
    """A program.

    Attributes:
        name: what it tries.
        source: with places to fill in.
        refused: what the allow-list says of it, in part.
        line: where.
    """

    name: str
    source: str
    refused: str
    line: int = 1

    def aimed_at(self, **places: object) -> str:
        """The program with its places filled in."""
        text = self.source
        for name, value in places.items():
            text = text.replace("{" + name + "}", str(value))
        return text


PROGRAMS = (
    # Files
    Hostile("write a file", "open('{folder}/new', 'w').write('x')", "call of .'write'"),
    Hostile("read a secret", "raise ValueError(open('{secret}').read())", "a raise"),
    Hostile("delete a file", "import os\nos.remove('{secret}')", "import 'os'"),
    Hostile("rename a file", "from os import rename\nrename('{secret}', '{folder}/gone')", "import from 'os'"),
    Hostile("make a folder", "__import__('os').mkdir('{folder}/deep')", "call of .'mkdir'"),
    Hostile(
        "follow a symbolic link", "import os\nos.symlink('{secret}', '/tmp/l')\nopen('/tmp/l', 'w')", "import 'os'"
    ),
    Hostile("a hard link", "import posix\nposix.link('{secret}', '{folder}/copy')", "import 'posix'"),
    Hostile("make it executable", "import sys\nsys.modules['posix'].chmod('{secret}', 0o777)", "import 'sys'"),
    Hostile("the environment of its parent", "raise ValueError(open('/proc/{parent}/environ').read())", "a raise"),
    Hostile("its own memory by /proc", "f = open('/proc/self/mem', 'r+b')\nf.seek(0)", "assignment outside"),
    Hostile("names in a folder", "import os\nraise ValueError(os.listdir('{folder}'))", "import 'os'"),
    Hostile(
        "raw calls to open", _RAW + "fd = libc.open(b'{folder}/raw', 0o102, 0o600)\nlibc.write(fd, b'x', 1)", "'ctypes'"
    ),
    Hostile(
        "rewrite the language itself",
        "import task_code\nopen(task_code.__file__, 'a').write('#')",
        "import 'task_code'",
    ),
    Hostile(
        "write to what is open",
        "import os\nfor fd in [0, *range(3, 256)]:\n    try: os.write(fd, b'x')\n    except OSError: pass",
        "'os'",
    ),
    Hostile(
        "shared memory",
        _RAW + "raise ValueError(libc.shmget(1, 2**30, 0o1600), libc.memfd_create(b'x', 0))",
        "'ctypes'",
    ),
    # Network
    Hostile("connect", _CONNECT, "'ctypes'", 2),
    Hostile("fetch a page", "import urllib.request as r\nr.urlopen('http://127.0.0.1:{port}')", "'urllib.request'"),
    Hostile("look up a name", "from socket import getaddrinfo\ngetaddrinfo('example.org', 80)", "'socket'"),
    # Processes and signals
    Hostile("fork bomb", "import os\nwhile True: os.fork()", "'os'"),
    Hostile("raw fork bomb", _RAW + "while True: libc.fork(), libc.vfork()", "'ctypes'"),
    Hostile("run a shell", "import os\nos.system('touch {folder}/shell')", "'os'"),
    Hostile("become a shell", "import os\nos.execv('/bin/sh', ['sh', '-c', 'touch {folder}/exec'])", "'os'"),
    Hostile("a subprocess", "import subprocess\nsubprocess.run(['touch', '{folder}/sub'])", "'subprocess'"),
    Hostile("threads", "import _thread\nfor _ in range(10**5): _thread.start_new_thread(print, ())", "'_thread'"),
    Hostile("a signal to its parent", "import os\nos.kill({parent}, 10)", "'os'"),
    Hostile("a signal to everybody", "import os\nos.kill(-1, 10)\nos.killpg(0, 10)", "'os'"),
    Hostile("raw signals", _RAW + "libc.kill({parent}, 10)\nlibc.syscall(234, {parent}, {parent}, 10)", "'ctypes'"),
    Hostile("trace its parent", _RAW + "raise ValueError(libc.ptrace(16, {parent}, 0, 0))", "'ctypes'"),
    Hostile("what is done at the end", "import atexit, os\natexit.register(os.kill, {parent}, 10)", "'atexit'"),
    # Time, memory, output
    Hostile("endless loop", "while True: pass", "a while"),
    Hostile(
        "a loop that nothing ends",
        "while True:\n    try:\n        while True: pass\n    except BaseException: pass",
        "a while",
    ),
    Hostile(
        "deaf to the limit",
        "import signal\nsignal.signal(signal.SIGXCPU, signal.SIG_IGN)\nwhile True: pass",
        "'signal'",
    ),
    Hostile("sleep forever", "import time\nwhile True: time.sleep(1000)", "'time'"),
    Hostile("wait for input", "import sys\nwhile not sys.stdin.read(): pass", "'sys'"),
    Hostile("memory bomb", "x = ['x' * 2**20 for _ in iter(int, 1)]", "assignment outside"),
    Hostile("one large block", "x = bytearray(2**40)", "assignment outside"),
    Hostile("a number without end", "x = 9 ** 9 ** 9", "the operator Pow"),
    Hostile("endless output", "import os\nwhile True: os.write(1, b'x' * 2**16)", "'os'"),
    Hostile(
        "a huge answer",
        "from task_code import Task\nclass Huge(Task):\n    description = 'x' * 10**8",
        "arithmetic with anything but numbers",
        3,
    ),
    Hostile("a deep expression", "x = " + "-" * 50_000 + "1", "cannot be parsed"),
    Hostile("deep brackets", "x = " + "(" * 40_000 + ")" * 40_000, "too many nested parentheses"),
    Hostile("deep recursion", "import sys\nsys.setrecursionlimit(10**9)\nf = lambda: f()\nf()", "'sys'"),
    Hostile("a crash", "import ctypes\nctypes.string_at(0)", "'ctypes'"),
    Hostile("an abort", "import os\nos.abort()", "'os'"),
    Hostile(
        "an answer that holds itself",
        "from task_code import Task\nclass Ring(Task):\n    def __init__(self):\n        a = []\n        a.append(a)\n"
        "        self.step('a', 'b', strategies=a)",
        "call of .'append'",
        5,
    ),
    # Ways out of the language
    Hostile(
        "from a tuple to everything",
        "for c in ().__class__.__base__.__subclasses__():\n"
        "    if 'wrap_close' in c.__name__: c.__init__.__globals__['system']('touch {folder}/escape')",
        "'__subclasses__'",
    ),
    Hostile(
        "by a format", "from task_code import Task\nx = '{0.__init__.__globals__}'.format(Task)", "call of .'format'", 2
    ),
    Hostile("by a decorator", "@print\nclass A: pass", "a decorator", 2),
    Hostile("by a metaclass", "class A(metaclass=print): pass", "derived from Task"),
    Hostile("by letters that look alike", "ｅｘｅｃ('import os; os.remove(\"{secret}\")')", "'exec'"),
    Hostile("by an import hook", "import sys\nsys.meta_path.insert(0, print)\nimport os.path", "'sys'"),
    Hostile("by the frame above", "import sys\nsys._getframe(1).f_globals['lock'](dict(), b'')", "'sys'"),
    Hostile("by builtins", "__builtins__['eval']('open(\"{secret}\", \"w\")')", "anything but a name"),
    Hostile("by a lambda in a default", "def f(x=(lambda: open('{folder}/new', 'w'))()): pass", "a function"),
    Hostile(
        "an exception that never ends",
        "class E(Exception):\n    def __str__(self):\n        while True: pass\nraise E",
        "a while",
        3,
    ),
    # Ways out of the box
    Hostile("undo the limits", "import resource as r\nr.setrlimit(r.RLIMIT_AS, (-1, -1))", "'resource'"),
    Hostile("another filter", _RAW + "raise ValueError(libc.prctl(22, 0, 0, 0, 0))", "'ctypes'"),
    Hostile(
        "namespaces of its own", _RAW + "raise ValueError(libc.unshare(0x10000000), libc.chroot(b'/'))", "'ctypes'"
    ),
    Hostile("mount", _RAW + "raise ValueError(libc.mount(b'/', b'/mnt', None, 4096, None))", "'ctypes'"),
    Hostile("machine code", "import mmap\nmmap.mmap(-1, 4096, prot=7)", "'mmap'"),
    Hostile(
        "calls that few know",
        _RAW + "raise ValueError([libc.syscall(n, 0, 0, 0, 0, 0, 0) for n in (425, 321, 250, 323, 310, 438)])",
        "'ctypes'",
    ),
    Hostile(
        "a pickle for an answer",
        "import os\nos.write(1, b'\\x80\\x04cos\\nsystem\\n(S\"x\"\\ntR.')\nos._exit(0)",
        "'os'",
    ),
    Hostile(
        "a forged answer",
        'import os\nos.write(1, b\'{"task": {"name": "__class__", "objects": {}}}\')\nos._exit(0)',
        "'os'",
    ),
)
"""All of them."""

"""Task code: what a program in its language comes to, and what is said where it comes to nothing."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from gensim2.design.sandbox import NoSandboxError, Sandbox, TaskCodeError, box, run_task_code, sandbox, task_code
from gensim2.design.sandbox.box import INSIDE, Limits
from gensim2.design.sandbox.code import criterion_arguments
from gensim2.errors import InputError
from gensim2.tasks.library import load_task, task_names
from gensim2.tasks.parse import parse_task

CODE = '''
from task_code import Object, Place, Randomization, Task, articulated_open, distance_articulated_rigidbody, pi


class FillSafe(Task):
    """put the ball into the safe"""

    def __init__(self):
        super().__init__()
        safe = Object("safe_rotate", randomization=Randomization(x=0.05, yaw=pi / 6, openness_mean=0.9))
        self.safe = safe
        self.ball = Object(asset_class="golf_ball", place=Place(at=(-0.2, -0.45), yaw=-pi / 2))
        near = distance_articulated_rigidbody(self.safe, self.ball)
        self.step("open", self.safe, done=articulated_open(self.safe, 0.6 + 0.1))
        self.step(name="place", object=self.safe, tool=self.ball, strategies=["drop", "throw"], done=[near])
        self.goal(near, articulated_open(object="safe"))
'''


def test_a_class_becomes_a_task() -> None:
    task = run_task_code(CODE)
    assert task.name == "FillSafe"
    assert task.description == "put the ball into the safe"
    assert {name: thing.asset_class for name, thing in task.objects.items()} == {
        "safe": "safe_rotate",
        "ball": "golf_ball",
    }
    assert task.objects["safe"].randomization.yaw == pytest.approx(0.5236, abs=1e-4)
    assert task.objects["ball"].place.at == (-0.2, -0.45)
    assert [step.strategies for step in task.steps] == [("open",), ("drop", "throw")]
    assert task.steps[0].done[0].threshold == pytest.approx(0.7)
    assert [criterion.type for criterion in task.success] == ["distance_articulated_rigidbody", "articulated_open"]


def test_the_example_in_the_documentation_is_a_task() -> None:
    text = (Path(__file__).parents[3] / "docs/sandbox.md").read_text()
    example = text.partition("## The language")[2].partition("```python\n")[2].partition("```")[0]
    assert run_task_code(example).name == "PutBallIntoDrawer"


def test_reference_code_of_every_stored_task_makes_the_same_task() -> None:
    """In one process that runs no code but ours; one of them goes through the sandbox as well."""
    programs = {name: task_code(load_task(name)) for name in task_names("paper")}
    script = (
        "import json, sys\nsys.path.insert(0, sys.argv[1])\nimport main, task_code\n"
        "given = json.load(sys.stdin)\ntask_code.add_criteria(vars(task_code), given['criteria'])\n"
        "print(json.dumps({name: main.answer(source, True) for name, source in given['programs'].items()}))"
    )
    done = subprocess.run(
        [sys.executable, "-I", "-c", script, str(INSIDE)],
        input=json.dumps({"programs": programs, "criteria": criterion_arguments()}),
        capture_output=True,
        text=True,
        check=True,
    )
    answers = json.loads(done.stdout)
    for name in programs:
        assert parse_task(answers[name]["task"]) == load_task(name).model_copy(update={"provenance": None})
        assert max(map(len, programs[name].splitlines())) < 400
    long = "PlaceGolfBallIntoDrawer"
    assert run_task_code(programs[long]) == load_task(long).model_copy(update={"provenance": None})


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (("self.safe = safe", "self.safe = ("), "syntax", "line 11: '(' was never closed"),
        (('"golf_ball"', "input()"), "refused", "line 12: a call of 'input' is not allowed"),
        (("import Object", "import Lid, Object"), "refused", "line 2: task_code has no 'Lid'; it has Object, Place"),
        (("done=[near]", "done=[n for n in near]"), "refused", "line 15: a list comprehension is not allowed"),
        (('"drop", "throw"', 'f"drop"'), "refused", "line 15: an f-string is not allowed"),
        (("done=[near]", "until=[near]"), "failed", "line 15: TypeError: Task.step() got an unexpected keyword"),
        (("(self.safe, 0.6 + 0.1)", "(self.safe, level=1)"), "failed", "takes object, threshold; not 'level'"),
        (("0.6 + 0.1", "1.5"), "invalid", "steps.0.done.0.threshold: input should be less than 1"),
        (('object="safe"', 'object="sofa"'), "invalid", "names an object 'sofa' that is not there"),
        (("-pi / 2", "1 / 0"), "refused", "line 12: a division by zero"),
        (('"golf_ball"', "1e99"), "invalid", "objects.ball.class"),
        (
            ("articulated_open(self.safe", "articulated_open(Object('x')"),
            "failed",
            "an object is used that was not given",
        ),
        (("class FillSafe(Task):", "class FillSafe:"), "refused", "line 5: a class must be derived from Task"),
    ],
)
def test_what_is_wrong_is_said_in_words_for_whoever_wrote_it(change: tuple[str, str], kind: str, words: str) -> None:
    with pytest.raises(TaskCodeError) as caught:
        run_task_code(CODE.replace(*change))
    assert caught.value.kind == kind
    assert words in str(caught.value)


def test_an_object_that_is_called_as_a_part_of_the_language_is_refused() -> None:
    task = json.loads(load_task("OpenBox").model_dump_json().replace('"box"', '"goal"'))
    with pytest.raises(InputError, match="no room for an object called 'goal'"):
        task_code(parse_task(task))


def test_a_program_that_takes_too_long_is_ended() -> None:
    with pytest.raises(TaskCodeError) as caught:
        run_task_code(CODE, Sandbox(sandbox().bubblewrap, Limits(wall_s=0.001)))
    assert caught.value.kind == "timeout"
    assert "longer than 0.001 s" in str(caught.value)


def test_without_a_filter_code_is_refused_with_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyseccomp", None)
    box.instructions.cache_clear()
    box.sandbox.cache_clear()
    try:
        with pytest.raises(NoSandboxError, match=r"generated code is not run: .*pip install 'gensim2\[llm\]'"):
            run_task_code(CODE)
    finally:
        box.instructions.cache_clear()
        box.sandbox.cache_clear()


def test_without_bubblewrap_the_filter_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    box.sandbox.cache_clear()
    try:
        found = sandbox()
        assert found.bubblewrap is None
        assert "apt-get install bubblewrap" in str(found.without)
        assert run_task_code(CODE).name == "FillSafe"
    finally:
        box.sandbox.cache_clear()


def test_a_kernel_that_has_no_filter_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """The filter of this test lets everything pass: the sandbox notices that it does not hold."""
    everything = bytes.fromhex("060000000000ff7f")  # BPF_RET | BPF_K, SECCOMP_RET_ALLOW
    monkeypatch.setattr(box, "instructions", lambda: everything)
    monkeypatch.setattr(shutil, "which", lambda name: None)
    box.sandbox.cache_clear()
    try:
        with pytest.raises(
            NoSandboxError, match=r"a trial of the seccomp filter failed: .*went through: access, kill, fork"
        ):
            sandbox()
    finally:
        box.sandbox.cache_clear()


HEAD = """from task_code import Object, Task, articulated_open
class Odd(Task):
    description = "open it"
    def __init__(self):
        self.thing = Object("drawer")
"""
STEP = """        self.step("open", self.thing, done=[articulated_open(self.thing, 0.5)])
"""
NINES = "9" * 4000

ODD = {
    "an attribute beyond ASCII": (
        HEAD + "        self.t\u00fcr = 1\n",
        6,
        "'t\u00fcr' is not allowed: names have small ASCII",
    ),
    "a name beyond ASCII": (HEAD + "        \u00e9 = 1\n", 6, "the name '\u00e9' cannot be assigned"),
    "a class beyond ASCII": (HEAD.replace("Odd", "\u00d6dd"), 2, "in ASCII, not '\u00d6dd'"),
    "an import beyond ASCII": (HEAD.replace("Object,", "\u00d3bject,"), 1, "has no '\u00d3bject'"),
    "an argument beyond ASCII": (HEAD + "        self.step('a', \u00f6bject=1)\n", 6, "'\u00f6bject'"),
    "letters that look alike": (HEAD + "        \uff45val('1')\n", 6, "a call of 'eval' is not allowed"),
    "a whole number in decimal": (HEAD + STEP.replace("0.5", NINES), 6, "a whole number of more than 64 bits"),
    "one that Python does not read": (HEAD + f"        x = {NINES * 2}\n", 6, "a whole number of more than 64 bits"),
    "one in other digits": (HEAD + STEP.replace("0.5", "0x" + "f" * 9000), 6, "a whole number of more than 64 bits"),
    "one that is used nowhere": (HEAD + "        x = -0b" + "1" * 70 + "\n", 6, "a whole number of more than 64 bits"),
    "a product": (HEAD + STEP.replace("0.5", "99999999999 * 99999999999"), 6, "a whole number of more than 64 bits"),
    "its own limit": (HEAD.replace("    def", f"    max_episode_steps = {NINES}\n    def"), 4, "of more than 64 bits"),
    "infinity": (HEAD + STEP.replace("0.5", "1e999"), 6, "a number that is not finite"),
    "no number": (HEAD + STEP.replace("0.5", "1e308 * 10 - 1e308 * 10"), 6, "a number that is not finite"),
    "a division by zero": (HEAD + STEP.replace("0.5", "1 / (1 - 1)"), 6, "a division by zero"),
    "a deep expression": (HEAD + STEP.replace("0.5", "-" * 5000 + "1"), 6, "it is nested too deeply"),
    "a deep sum": (HEAD + STEP.replace("0.5", "(" + "1 + " * 950 + "1) * 0"), 6, ""),
    "deep attributes": (HEAD + "        x = self" + ".a" * 5000 + "\n", 6, "it is nested too deeply"),
    "a null byte": (HEAD + "        x = 'a\0b'\n", 6, r"a character that no text has ('\x00')"),
    "a null byte in disguise": (HEAD + r"        x = 'a\0b'" + "\n", 6, r"a character that no text has ('\x00')"),
    "half a character": (HEAD + "        x = '\ud800'\n", 6, r"a character that no text has ('\ud800')"),
    "half a character in disguise": (
        HEAD + r"        x = '\udc00'" + "\n",
        6,
        r"a character that no text has ('\udc00')",
    ),
    "a byte order mark": ("\ufeff" + HEAD, 1, "invalid non-printable character"),
}


@pytest.mark.parametrize("name", ODD)
def test_odd_programs_are_answered_by_name_and_line(name: str) -> None:
    source, line, words = ODD[name]
    with pytest.raises(TaskCodeError) as caught:
        run_task_code(source)
    assert "no answer" not in str(caught.value)
    if words:
        assert any(told.startswith(f"line {line}: ") and words in told for told in caught.value.problems), caught.value


def test_a_character_may_be_named() -> None:
    assert run_task_code(HEAD.replace("open it", r"open \N{LATIN SMALL LETTER I}t") + STEP).description == "open it"


def test_what_cannot_be_written_down_is_an_answer_too() -> None:
    """The allow-list is off: a number of 100,000 digits goes through, and the answer says why there is no task."""
    source = HEAD + STEP.replace("0.5", "10 ** 100_000")
    ended = sandbox().run(source, criterion_arguments(), checked=False)
    answer = json.loads(ended.answer)
    assert answer["kind"] == "failed"
    assert "ValueError" in answer["problems"][0]

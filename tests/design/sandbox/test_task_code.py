"""Task code: the values that programs give, and the error messages."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import pytest

from gensim2.core.errors import InputError
from gensim2.design.sandbox import TaskCodeError, run_task_code, task_code
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
    text = (Path(__file__).parents[3] / "docs/reference/sandbox.md").read_text()
    example = text.partition("## The language")[2].partition("```python\n")[2].partition("```")[0]
    assert run_task_code(example).name == "PutBallIntoDrawer"


def test_reference_code_of_every_stored_task_makes_the_same_task() -> None:
    for name in task_names("paper"):
        source = task_code(load_task(name))
        assert run_task_code(source) == load_task(name).model_copy(update={"provenance": None})
        assert max(map(len, source.splitlines())) < 400


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (("self.safe = safe", "self.safe = ("), "syntax", "line 11: '(' was never closed"),
        (('"golf_ball"', "input()"), "refused", "line 12: a call of 'input' is not allowed"),
        (
            ("import Object", "import Lid, Object"),
            "refused",
            "line 2: task_code has no 'Lid'; a program can import Object, Place",
        ),
        (("done=[near]", "done=[n for n in near]"), "refused", "line 15: a list comprehension is not allowed"),
        (('"drop", "throw"', 'f"drop"'), "refused", "line 15: an f-string is not allowed"),
        (("done=[near]", "until=[near]"), "failed", "line 15: TypeError: Task.step() got an unexpected keyword"),
        (("(self.safe, 0.6 + 0.1)", "(self.safe, level=1)"), "failed", "takes object, threshold; not 'level'"),
        (("0.6 + 0.1", "1.5"), "invalid", "steps.0.done.0.threshold: input should be less than 1"),
        (('object="safe"', 'object="sofa"'), "invalid", "names an unknown object 'sofa'"),
        (("-pi / 2", "1 / 0"), "refused", "line 12: division by zero"),
        (('"golf_ball"', "1e99"), "invalid", "objects.ball.class"),
        (
            ("articulated_open(self.safe", "articulated_open(Object('x')"),
            "failed",
            "an object was used before it was assigned",
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
    with pytest.raises(InputError, match="cannot contain an object named 'goal'"):
        task_code(parse_task(task))


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
        "'t\u00fcr' is not allowed: names consist of lower-case ASCII",
    ),
    "a name beyond ASCII": (HEAD + "        \u00e9 = 1\n", 6, "the name '\u00e9' cannot be assigned"),
    "a class beyond ASCII": (HEAD.replace("Odd", "\u00d6dd"), 2, "ASCII letters and digits, not '\u00d6dd'"),
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
    "a division by zero": (HEAD + STEP.replace("0.5", "1 / (1 - 1)"), 6, "division by zero"),
    "a deep expression": (HEAD + STEP.replace("0.5", "-" * 5000 + "1"), 6, "the program is nested too deeply"),
    "a deep sum": (HEAD + STEP.replace("0.5", "(" + "1 + " * 950 + "1) * 0"), 6, ""),
    "deep attributes": (HEAD + "        x = self" + ".a" * 5000 + "\n", 6, "the program is nested too deeply"),
    "a null byte": (HEAD + "        x = 'a\0b'\n", 6, r"a control character ('\x00')"),
    "a null byte in disguise": (HEAD + r"        x = 'a\0b'" + "\n", 6, r"a control character ('\x00')"),
    "half a character": (HEAD + "        x = '\ud800'\n", 6, r"a control character ('\ud800')"),
    "half a character in disguise": (
        HEAD + r"        x = '\udc00'" + "\n",
        6,
        r"a control character ('\udc00')",
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


def test_python_says_nothing_about_a_program_on_the_terminal() -> None:
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        assert run_task_code(HEAD.replace("open it", r"open \_ it") + STEP).description == r"open \_ it"
    assert said == []


SAME = {
    "a docstring in place of a description": ('    """open it"""\n', "open it"),
    "an attribute of the class": ('    description = "open it"\n', "open it"),
    "the later attribute": ('    description = "close it"\n    description = "open it"\n', "open it"),
}


@pytest.mark.parametrize("name", SAME)
def test_a_description_comes_from_the_class(name: str) -> None:
    line, description = SAME[name]
    assert run_task_code(HEAD.replace('    description = "open it"\n', line) + STEP).description == description


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("self.other = self.thing", "line 6: ValueError: one object cannot be both 'thing' and 'other'"),
        ("self.description = Object('drawer')", "line 6: ValueError: an object cannot be named 'description'"),
        ("x = self.absent", "line 6: AttributeError: self has no attribute 'absent'"),
        ("self.step('a')", "line 6: TypeError: Task.step() missing 1 required positional argument: 'object'"),
        ("self.step('a', self.thing, name='b')", "line 6: TypeError: Task.step() got multiple values"),
        ("self.step('a', object=self.thing, object='b')", "line 6: the argument 'object' is given twice"),
        (
            "x = Object('a', 'b', 'c', 'd', 'e')",
            "takes asset_class, instances, place, randomization; 5 arguments were given",
        ),
    ],
)
def test_a_wrong_call_is_answered_by_line(line: str, words: str) -> None:
    with pytest.raises(TaskCodeError) as caught:
        run_task_code(f"{HEAD}        {line}\n{STEP}")
    assert words in str(caught.value)


def test_a_name_of_the_class_is_not_known_in_its_function() -> None:
    with pytest.raises(TaskCodeError, match="line 7: NameError: name 'level' is not defined"):
        run_task_code(HEAD.replace("    def", "    level = 0.5\n    def") + STEP.replace("0.5", "level"))

"""Read task files of schema version 1: one object, one list of criteria, one solver config (``solver.yaml``)."""

from __future__ import annotations

from typing import Any

from gensim2.core.errors import InputError

ROLE = "object"
"""Name of the only object of a task of schema version 1."""
STEP = "act"
STRATEGY = "solver"
"""Name of the only step of a task of schema version 1, and of the step's only strategy."""

FIELDS = ("schema_version", "name", "description", "asset_class", "success", "randomization", "max_episode_steps")
_OWN = ("asset_class", "success")
_PLACES = {
    ("objects", ROLE, "class"): ("asset_class",),
    ("objects", ROLE, "randomization"): ("randomization",),
    ("steps", 0, "done"): ("success",),
}


def is_version_1(data: dict[str, Any]) -> bool:
    """Return whether the fields of a task are fields of schema version 1."""
    return "objects" not in data and (data.get("schema_version") == 1 or any(field in data for field in _OWN))


def upgraded(data: dict[str, Any], file: str | None) -> dict[str, Any]:
    """Convert a task to the fields of version 2; invalid values are kept, so that the validation reports them.

    Raises:
        InputError: a field of version 1 is missing, or ``schema_version`` is not 1.
    """
    given = dict(data)
    if given.pop("schema_version", 1) != 1:
        raise InputError(
            "must be 1 for a task with the fields asset_class and success",
            file=file,
            field="schema_version",
            remedy="leave schema_version out, or write the task with the fields objects and steps",
        )
    for field in _OWN:
        if field not in given:
            raise InputError("field required", file=file, field=field)
    success = given.pop("success")
    if success == []:
        raise InputError("must contain at least one criterion", file=file, field="success")
    if isinstance(success, list):
        success = [{**entry, "object": ROLE} if isinstance(entry, dict) else entry for entry in success]
    role = {"class": given.pop("asset_class")}
    if "randomization" in given:
        role["randomization"] = given.pop("randomization")
    step = {"name": STEP, "object": ROLE, "strategies": [STRATEGY], "done": success}
    return {**given, "schema_version": 2, "objects": {ROLE: role}, "steps": [step]}


def place_of(location: tuple[int | str, ...]) -> tuple[int | str, ...]:
    """Convert the location of a field in schema version 2 to the field's location in version 1, for error messages."""
    for new, old in _PLACES.items():
        if location[: len(new)] == new:
            return old + location[len(new) :]
    return location

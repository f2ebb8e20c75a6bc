"""The main findings of docs/results/tasks.md, counted from the package's figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import mean

from gensim2.rollout.tally import interval
from gensim2.tasks.figures import Condition, Figure
from gensim2.tasks.library import load_task
from gensim2.tasks.published import MEASURED_IN_ALL, PAPER

TYPES = ("single-step", "long-horizon")


def claims(rows: Sequence[Figure]) -> str:
    """Return the findings as a Markdown list; conditions without rows are left out."""
    found = [_beside_the_paper(rows), _by_its_method(rows), _wide(rows)]
    return "\n".join(f"{number}. {text}" for number, text in enumerate(filter(None, found), start=1)) + "\n"


def _beside_the_paper(rows: Iterable[Figure]) -> str:
    own = [row for row in rows if _is_plain_original(row)]
    if not own:
        return ""
    above: list[Figure] = []
    not_above: list[Figure] = []
    for row in own:
        if row.task in PAPER:
            low, _ = interval(row.paper, row.episodes)
            (above if low > PAPER[row.task][0] else not_above).append(row)
    named = ", ".join(
        f"{row.task} {row.paper / row.episodes:.2f} against {PAPER[row.task][0]:.2f}" for row in not_above
    )
    return (
        "**Compared with the paper** (real objects, the original's physics, scenes not redrawn, one attempt, verdict "
        f"`paper`): {_means(own, 'paper')}. The paper reports {_published()}; its release reaches {_released()}. "
        f"The 95 % interval lies above the paper's figure in {len(above)} of {len(above) + len(not_above)} rows"
        + (f" (exception: {named})." if named else ".")
    )


def _by_its_method(rows: Iterable[Figure]) -> str:
    found = {
        name: [row for row in rows if _is_plain_original(row, **{field: True})]
        for name, field in (
            ("one plan per step by the first strategy, no replanning", "one_plan"),
            ("open loop, all steps planned at the start", "open_loop"),
        )
    }
    said = [f"{name}: {_means(own, 'paper')}" for name, own in found.items() if own]
    return f"**Without parts of the method** (same conditions): {'; '.join(said)}." if said else ""


def _wide(rows: Iterable[Figure]) -> str:
    own = [
        row
        for row in rows
        if row.condition.objects == "real"
        and row.condition.physics == "default"
        and row.condition.deviations == ["ranges wide"]
        and row.source is not None
    ]
    if not own:
        return ""
    return (
        "**Beyond the paper's ranges** (real objects, default physics, randomization `wide`, verdict `strict`): "
        f"{_means(own, 'strict')}."
    )


def _is_plain_original(row: Figure, **given: bool) -> bool:
    """Whether it is of real objects in the original's physics, measured at a commit that is known, and else plain."""
    wanted = {"one_plan": False, "open_loop": False, **given}
    plain = row.condition.model_copy(update={"one_plan": False, "open_loop": False})
    return (
        row.source is not None
        and plain == Condition(**{**plain.model_dump(), "objects": "real", "physics": "original"})
        and plain.is_plain
        and all(getattr(row.condition, name) == value for name, value in wanted.items())
    )


def _means(rows: Sequence[Figure], verdict: str) -> str:
    """Mean share over the tasks of each type, with the number of tasks and episodes."""
    parts = []
    for kind in TYPES:
        own = [row for row in rows if load_task(row.task).is_single_step == (kind == TYPES[0])]
        if own:
            share = mean(getattr(row, verdict) / row.episodes for row in own)
            parts.append(f"{kind} {share:.3f} ({len(own)} tasks, {sum(row.episodes for row in own)} episodes)")
    return ", ".join(parts)


def _published() -> str:
    shares: dict[str, list[float]] = {kind: [] for kind in TYPES}
    for task, (share, _) in PAPER.items():
        shares[TYPES[0] if load_task(task).is_single_step else TYPES[1]].append(share)
    return " and ".join(f"{mean(own):.2f}" for own in shares.values())


def _released() -> str:
    return " and ".join(f"{held / of:.2f} ({held} of {of})" for held, of in MEASURED_IN_ALL.values())

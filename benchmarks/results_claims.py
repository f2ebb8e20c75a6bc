"""The claims at the head of docs/results/tasks.md, counted from the package's figures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from statistics import mean

from gensim2.rollout.tally import interval
from gensim2.tasks.figures import Condition, Figure
from gensim2.tasks.library import load_task
from gensim2.tasks.published import MEASURED_IN_ALL, PAPER

TYPES = ("single-step", "long-horizon")


def claims(rows: Sequence[Figure]) -> str:
    """Markdown list of the claims; of what was not measured there is none."""
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
    named = ", ".join(f"{row.task} {row.paper / row.episodes:.2f} beside {PAPER[row.task][0]:.2f}" for row in not_above)
    return (
        "**Beside the paper.** Real objects, the original's physics, the first draw of each scene, one attempt, "
        f"counted as the paper counts: {_means(own, 'paper')}; the paper {_published()}, its release {_released()}. "
        f"The whole 95 % interval lies above the paper's figure in {len(above)} of {len(above) + len(not_above)} rows"
        + (f" (not in: {named})." if named else ".")
    )


def _by_its_method(rows: Iterable[Figure]) -> str:
    found = {
        name: [row for row in rows if _is_plain_original(row, **{field: True})]
        for name, field in (
            ("one plan a step, by its first strategy, never looked at again", "one_plan"),
            ("everything planned at the start", "open_loop"),
        )
    }
    said = [f"{name}: {_means(own, 'paper')}" for name, own in found.items() if own]
    return f"**With less than our method**, the same scenes' ranges and verdict: {'; '.join(said)}." if said else ""


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
        "**Beyond the paper's ranges.** Real objects, default physics, `wide` ranges with masses, frictions and the "
        f"robot's start drawn, the `strict` verdict: {_means(own, 'strict')}."
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

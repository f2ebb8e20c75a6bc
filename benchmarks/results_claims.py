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
        f"{row.task} (our rate is {row.paper / row.episodes:.2f}, the paper's {PAPER[row.task][0]:.2f})"
        for row in not_above
    )
    return (
        "**Compared with the paper.** The mean success rates of our planner are "
        f"{_means(own, 'paper')}. For these two types of tasks, the paper reports {_published()}, and the authors' "
        f"release reaches {_released()}. We use the paper's conditions: real objects, the physics settings of the "
        "GenSim2 release, one attempt per episode and the verdict `paper`. Invalid object placements are not replaced. "
        f"In {len(above)} of {len(above) + len(not_above)} tasks the 95 % interval of our rate lies above the paper's "
        "figure." + (f" The exception{'s are' if len(not_above) > 1 else ' is'} {named}." if named else "")
    )


def _by_its_method(rows: Iterable[Figure]) -> str:
    found = {
        name: [row for row in rows if _is_plain_original(row, **{field: True})]
        for name, field in (
            ("If the planner plans each step only once, with its first strategy,", "one_plan"),
            ("If the planner plans all steps at the start of the episode (open loop),", "open_loop"),
        )
    }
    said = [f"{name} the mean success rates are {_means(own, 'paper')}." for name, own in found.items() if own]
    return f"**Simpler planners under the same conditions.** {' '.join(said)}" if said else ""


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
        "**Wider ranges.** The randomization `wide` varies scenes more than the paper does. With this randomization, "
        f"real objects, default physics and the verdict `strict`, the mean success rates are {_means(own, 'strict')}."
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
            parts.append(f"{share:.3f} on {kind} tasks ({len(own)} tasks, {sum(row.episodes for row in own)} episodes)")
    return " and ".join(parts)


def _published() -> str:
    shares: dict[str, list[float]] = {kind: [] for kind in TYPES}
    for task, (share, _) in PAPER.items():
        shares[TYPES[0] if load_task(task).is_single_step else TYPES[1]].append(share)
    return " and ".join(f"{mean(own):.2f}" for own in shares.values())


def _released() -> str:
    return " and ".join(f"{held / of:.2f} ({held} of {of})" for held, of in MEASURED_IN_ALL.values())

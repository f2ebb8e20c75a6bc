"""Published figures apply to the published task, and not to others of its name."""

from __future__ import annotations

from gensim2.tasks.library import load_task
from gensim2.tasks.published import MEASURED, PAPER, paper_of, released_of


def test_a_task_that_only_has_the_name_has_no_figure() -> None:
    own = load_task("OpenDrawer")
    other = load_task("PushDrawerClose").model_copy(update={"name": "OpenDrawer"})
    assert paper_of(own) == PAPER["OpenDrawer"]
    assert released_of(own) == MEASURED["OpenDrawer"]
    assert paper_of(other) is None
    assert released_of(other) is None
    renamed = own.model_copy(
        update={"steps": tuple(s.model_copy(update={"strategies": ("other",)}) for s in own.steps)}
    )
    assert paper_of(renamed) == PAPER["OpenDrawer"], "strategies are ours"

"""``gensim2 solve``: one plan of one task, without executing it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gensim2_kpam as kpam
from gensim2.files import check_writable, write_json
from gensim2.pipeline.inputs import read_task_input
from gensim2.pipeline.records import SCHEMA_VERSION
from gensim2.planning.scene import Scene


@dataclass(frozen=True)
class SolveResult:
    """One plan on the scene of one seed."""

    task: str
    asset_class: str
    instance: str
    plan: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "schema_version": SCHEMA_VERSION,
            "task": self.task,
            "class": self.asset_class,
            "instance": self.instance,
            "plan": self.plan,
        }


def solve(
    task: str,
    *,
    seed: int = 0,
    assets: str | Path | None = None,
    instances: str = "all",
    out: Path | None = None,
    view: Callable[[Scene, kpam.Plan], None] | None = None,
) -> SolveResult:
    """Plan the motion of a task on the scene of one seed as an episode would, without executing it.

    Where the whole motion cannot be had, the plan holds its longest part (status ``partial``), as episodes take it.

    Args:
        task: name of a library task, or a folder that holds task.yaml and solver.yaml.
        seed: of the scene.
        assets: as for ``demo``.
        instances: as for ``demo``; the seed draws one of several.
        out: folder in which to leave ``plan.json``.
        view: called with the scene and the plan at the end, for example to show them.

    Raises:
        InputError: an argument cannot be used.
    """
    given = read_task_input(task, assets, instances, seed)
    if out is not None:
        check_writable(Path(out) / "plan.json")
    # Only now what takes seconds to import.
    from gensim2.pipeline.worker import plan_episode
    from gensim2.sim.lane import Lane

    lane = Lane(given.spec, assets=given.library, instances=given.instances)
    lane.reset(seed)
    scene = lane.scene_state()
    plan, _ = plan_episode(lane, given.config)
    result = SolveResult(given.spec.name, given.spec.asset_class, lane.instance.id, plan.to_dict())
    if out is not None:
        write_json(Path(out) / "plan.json", result.to_dict())
    if view is not None:
        view(scene, plan)
    return result

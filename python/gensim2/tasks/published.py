"""List success rates for comparisons.

The rates come from the paper (Table 4), and from its authors' code as we ran it.
"""

from __future__ import annotations

from gensim2.tasks.library import load_task, packaged_names
from gensim2.tasks.spec import TaskSpec

PAPER: dict[str, tuple[float, float]] = {
    "OpenBox": (0.84, 0.07),
    "CloseBox": (0.94, 0.03),
    "OpenLaptop": (0.76, 0.03),
    "CloseLaptop": (0.95, 0.01),
    "TurnOnFaucet": (0.67, 0.05),
    "TurnOffFaucet": (0.72, 0.03),
    "OpenDrawer": (0.8, 0.02),
    "PushDrawerClose": (0.87, 0.06),
    "SwingBucketHandle": (0.89, 0.03),
    "PressToasterLever": (0.96, 0.03),
    "RotateMicrowaveDoor": (0.92, 0.01),
    "CloseSafe": (0.8, 0.04),
    "OpenSafe": (0.62, 0.03),
    "PushToasterForward": (0.99, 0.01),
    "CloseSuitcaseLid": (0.82, 0.05),
    "SwingSuitcaseLidOpen": (0.81, 0.06),
    "RelocateSuitcase": (0.8, 0.04),
    "LiftBucketUpright": (0.76, 0.05),
    "MoveBagForward": (0.72, 0.05),
    "CloseMicrowave": (0.53, 0.04),
    "SwingDoorOpen": (0.79, 0.03),
    "ToggleDoorClose": (0.8, 0.05),
    "CloseRefrigeratorDoor": (0.82, 0.03),
    "OpenRefrigeratorDoor": (0.75, 0.06),
    "PlaceGolfBallIntoDrawer": (0.56, 0.09),
    "DropAppleIntoDrawer": (0.58, 0.05),
    "StashCupInBox": (0.4, 0.09),
    "PutCrackerBoxInBox": (0.48, 0.08),
    "StoreBlockInBox": (0.62, 0.03),
    "PlaceCrackerBoxIntoDrawer": (0.53, 0.08),
    "PlaceLemonIntoDrawer": (0.53, 0.06),
    "PlaceSoftBallIntoDrawer": (0.58, 0.06),
    "PlaceGolfBallIntoBox": (0.58, 0.06),
    "DropAppleIntoBox": (0.64, 0.04),
    "PlaceCrackerBoxIntoRefrigerator": (0.26, 0.09),
    "StoreLemonInRefrigerator": (0.48, 0.07),
    "SecureGoldInSafe": (0.21, 0.05),
    "FillMugWithWater": (0.13, 0.04),
}
"""Mean rate and deviation over five runs, of 24 single-step tasks and 14 long tasks. The last four have half the
ranges.
"""

MEASURED: dict[str, tuple[int, int]] = {
    "OpenBox": (8, 10),
    "CloseBox": (10, 10),
    "OpenLaptop": (4, 10),
    "CloseLaptop": (10, 10),
    "TurnOnFaucet": (6, 10),
    "TurnOffFaucet": (3, 10),
    "OpenDrawer": (6, 10),
    "PushDrawerClose": (9, 10),
    "SwingBucketHandle": (9, 10),
    "PressToasterLever": (10, 10),
    "RotateMicrowaveDoor": (8, 10),
    "CloseSafe": (6, 10),
    "OpenSafe": (7, 10),
    "PushToasterForward": (10, 10),
    "CloseSuitcaseLid": (10, 10),
    "SwingSuitcaseLidOpen": (10, 10),
    "RelocateSuitcase": (4, 10),
    "LiftBucketUpright": (6, 10),
    "MoveBagForward": (7, 10),
    "CloseMicrowave": (8, 10),
    "SwingDoorOpen": (6, 10),
    "ToggleDoorClose": (8, 10),
    "CloseRefrigeratorDoor": (7, 10),
    "OpenRefrigeratorDoor": (9, 10),
}
"""Results of the release of the original GenSim2: successes by the paper's verdict, and number of episodes.

Objects are real, and ranges are the paper's. Here ten of the thirty episodes of a task count; ``MEASURED_IN_ALL`` has
the totals of all thirty.
"""

MEASURED_IN_ALL: dict[str, tuple[int, int]] = {"single-step": (556, 720), "long-horizon": (8, 50)}
"""Total successes and episodes of the release: 24 single-step tasks with 30 episodes each, 5 long tasks with 10."""


def paper_of(task: TaskSpec) -> tuple[float, float] | None:
    """Return the success rate that the paper reports for a task, as mean and deviation. Return None for a task that is
    not from the paper, even if the task has the name of a task in the paper.
    """
    return PAPER.get(task.name) if _is_published(task) else None


def released_of(task: TaskSpec) -> tuple[int, int] | None:
    """Return the numbers of successful and of all episodes of the authors' code.

    Return None if the task is not from the paper.
    """
    return MEASURED.get(task.name) if _is_published(task) else None


def _is_published(task: TaskSpec) -> bool:
    return task.name in packaged_names() and _bare(task) == _bare(load_task(task.name))


def _bare(task: TaskSpec) -> TaskSpec:
    steps = tuple(step.model_copy(update={"strategies": ()}) for step in task.steps)
    return task.model_copy(update={"provenance": None, "steps": steps})

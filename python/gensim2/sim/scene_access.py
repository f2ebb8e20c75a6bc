"""Access to the robot and the objects of a built scene, shared by the registered and the headless environment."""

from __future__ import annotations

from collections.abc import Mapping

from gensim2.core.errors import GenSim2Error
from gensim2.scenes.initial_state import InitialState
from gensim2.sim.parts import Part
from gensim2.sim.scene_state import RobotReader, StandingRobot, measure
from gensim2.tasks.measurement import Measurement


class SceneAccessMixin:
    """Access to the robot and the objects of the scene of the last reset."""

    _initial_state: InitialState | None = None
    _parts: Mapping[str, Part]
    _robot: RobotReader | StandingRobot

    def _require_open(self) -> None:
        """Refuse to go on with what was closed."""

    @property
    def initial_state(self) -> InitialState:
        """Initial state that was drawn at the last reset."""
        self._require_open()
        if self._initial_state is None:
            raise GenSim2Error("the environment has not been reset yet")
        return self._initial_state

    @property
    def parts(self) -> Mapping[str, Part]:
        """The objects as they stand in the scene, by name."""
        assert self.initial_state
        return self._parts

    @property
    def object_warnings(self) -> tuple[str, ...]:
        """Losses in building the objects, by object."""
        return tuple(f"{part.name}: {warning}" for part in self.parts.values() for warning in part.warnings)

    def measure(self) -> Measurement:
        """Measure the present instant in the world frame, for criteria and verdicts; without an arm, as if it stood
        still."""
        return measure(self._robot, self.parts)

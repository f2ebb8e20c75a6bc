"""Controllers around another one, which say of themselves what that one says."""

from __future__ import annotations

from collections.abc import Sequence

from gensim2.perception import ObservationSpec
from gensim2.rollout.controller import (
    Controller,
    Event,
    Reference,
    events_of,
    history_of,
    reference_of,
    spec_of,
    turn_of,
)
from gensim2.rollout.record import StepRecord


class WrappedController:
    """Base of a controller around another one; ``_controller`` is the other.

    What a controller may tell beside its actions is read from the one inside.
    """

    _controller: Controller

    @property
    def observation_spec(self) -> ObservationSpec:
        """Spec of the controller's next observation."""
        return spec_of(self._controller)

    @property
    def reference(self) -> Reference | None:
        """The controller's."""
        return reference_of(self._controller)

    @property
    def turn(self) -> str | None:
        """The controller's."""
        return turn_of(self._controller)

    @property
    def history(self) -> Sequence[StepRecord]:
        """The controller's."""
        return history_of(self._controller)

    @property
    def events(self) -> Sequence[Event]:
        """The controller's."""
        return events_of(self._controller)

"""Sources of a library's objects of one kind."""

from __future__ import annotations

from abc import ABC, abstractmethod

from gensim2.core.errors import InputError, near
from gensim2.core.seeding import rng
from gensim2.objects.types import ONLY_ID, ArticulatedObject, Hulls, Kind, RigidObject, Source


class Shelf(ABC):
    """Objects of one kind from one source. Pickles.

    Attributes:
        kind: of its objects.
        source: who made them.
        license: terms of their data.
    """

    kind: Kind
    source: Source
    license: str

    @abstractmethod
    def classes(self) -> tuple[str, ...]:
        """Class names, sorted."""

    @abstractmethod
    def instances(self, asset_class: str) -> tuple[str, ...]:
        """Ids of a class, sorted (numbers by value)."""

    @abstractmethod
    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default") -> ArticulatedObject | RigidObject:
        """A prepared object; the first time it is made and kept in the cache.

        Args:
            hulls: how real meshes become collision parts.

        Raises:
            AssetError: it cannot be used; says why.
        """

    @abstractmethod
    def describe(self, asset_class: str) -> str:
        """One phrase about a class."""

    @abstractmethod
    def joint_type(self, asset_class: str) -> str | None:
        """Return the usual joint type of a class, ``"revolute"`` or ``"prismatic"``; None of a rigid one."""

    def holds(self, asset_class: str, instance_id: str) -> bool:
        """Whether an instance can be asked for."""
        return instance_id in self.instances(asset_class)

    def remedy(self, asset_class: str, instance_id: str) -> str:
        """Return a remedy for a request of an instance that it does not hold."""
        return near(instance_id, self.instances(asset_class))

    def new(self, asset_class: str) -> tuple[str, ...]:
        """Ids of a fixed number of objects beyond those that ``instances`` lists.

        Raises:
            InputError: there are none.
        """
        raise InputError(
            f"{asset_class} is {self.source}: there are no new ones beside those that are listed",
            field="instances",
            remedy="all, train, test or an id; new objects are generated (--assets builtin)",
        )

    def sample(self, asset_class: str, count: int, seed: int) -> tuple[str, ...]:
        """``count`` ids drawn by the seed, no two the same; all of a class that has no more."""
        ids = self.instances(asset_class)
        order = rng(seed, f"sample/{asset_class}").permutation(len(ids))[:count]
        return tuple(ids[i] for i in sorted(order))


class RigidShelf(Shelf):
    """Rigid objects: each is the only one of its class."""

    kind: Kind = "rigid"

    def instances(self, asset_class: str) -> tuple[str, ...]:
        return (ONLY_ID,)

    def new(self, asset_class: str) -> tuple[str, ...]:
        """The only one: there is nothing beside it."""
        return (ONLY_ID,)

    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default") -> RigidObject:
        return self.load_rigid(asset_class, hulls)

    @abstractmethod
    def load_rigid(self, asset_class: str, hulls: Hulls = "default") -> RigidObject:
        """As :meth:`load`."""

    def joint_type(self, asset_class: str) -> None:
        return None

"""Base classes for the sources of a library's objects."""

from __future__ import annotations

from abc import ABC, abstractmethod

from gensim2.core.errors import InputError, near
from gensim2.core.seeding import rng
from gensim2.objects.types import ONLY_ID, ArticulatedObject, Hulls, Kind, RigidObject, Source


class Shelf(ABC):
    """A source of objects of one kind. Instances can be pickled.

    Attributes:
        source: ``"generated"`` or ``"real"``.
        license: licence terms of the objects' data.
    """

    kind: Kind
    source: Source
    license: str

    @abstractmethod
    def classes(self) -> tuple[str, ...]:
        """Return the class names, sorted."""

    @abstractmethod
    def instances(self, asset_class: str) -> tuple[str, ...]:
        """Return the sorted ids of a class. Ids that are numbers are sorted by their value."""

    @abstractmethod
    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default") -> ArticulatedObject | RigidObject:
        """Return an object ready for simulation; the first call prepares it and stores it in the cache.

        Args:
            hulls: method by which real meshes become collision parts.

        Raises:
            AssetError: the object cannot be used; the message gives the reason.
        """

    @abstractmethod
    def describe(self, asset_class: str) -> str:
        """Return one phrase that describes a class."""

    @abstractmethod
    def joint_type(self, asset_class: str) -> str | None:
        """Return the usual joint type of a class, ``"revolute"`` or ``"prismatic"``; None for a rigid class."""

    def holds(self, asset_class: str, instance_id: str) -> bool:
        """Return whether the source has this instance, even if ``instances`` does not list it."""
        return instance_id in self.instances(asset_class)

    def remedy(self, asset_class: str, instance_id: str) -> str:
        """Return advice for an unknown instance id, with similar ids."""
        return near(instance_id, self.instances(asset_class))

    def new(self, asset_class: str) -> tuple[str, ...]:
        """Return the ids of new generated objects: a fixed number of objects that ``instances`` does not list.

        Raises:
            InputError: the class cannot generate new objects, because it consists of the listed objects only.
        """
        raise InputError(
            f"the class {asset_class} has no new instances, because its objects are {self.source}",
            field="instances",
            remedy="select all, train, test or an id, or use generated objects (--assets builtin)",
        )

    def sample(self, asset_class: str, count: int, seed: int) -> tuple[str, ...]:
        """Sample ``count`` different ids; return all ids if the class has fewer."""
        ids = self.instances(asset_class)
        order = rng(seed, f"sample/{asset_class}").permutation(len(ids))[:count]
        return tuple(ids[i] for i in sorted(order))


class RigidShelf(Shelf):
    """A source of rigid objects with exactly one object per class."""

    kind: Kind = "rigid"

    def instances(self, asset_class: str) -> tuple[str, ...]:
        return (ONLY_ID,)

    def new(self, asset_class: str) -> tuple[str, ...]:
        """Return the class's only id."""
        return (ONLY_ID,)

    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default") -> RigidObject:
        return self.load_rigid(asset_class, hulls)

    @abstractmethod
    def load_rigid(self, asset_class: str, hulls: Hulls = "default") -> RigidObject:
        """Return a rigid object, like :meth:`load`."""

    def joint_type(self, asset_class: str) -> None:
        return None

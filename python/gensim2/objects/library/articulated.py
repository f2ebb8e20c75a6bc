"""Define the sources of articulated objects: generated objects, and folders of real models."""

from __future__ import annotations

import hashlib
import os
import re
from functools import cached_property
from pathlib import Path

from gensim2.core.errors import InputError
from gensim2.core.seeding import rng
from gensim2.objects.generators.classes import class_modules, object_classes
from gensim2.objects.generators.generate import LICENSE as GENERATED_LICENSE
from gensim2.objects.generators.generate import generate
from gensim2.objects.known import DESCRIPTIONS, JOINT_TYPES
from gensim2.objects.library.cache import SHARED_MODULES, file_name, prepared, source_digest
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.shelf import Shelf
from gensim2.objects.library.urdf import URDF, plain_name
from gensim2.objects.model import Model
from gensim2.objects.types import ArticulatedObject, AssetError, Hulls, Kind, Source

LARGEST_NUMBER = 10**6
NEW = 100
"""Number of objects that ``--instances new`` selects."""
GENERATOR_MODULES = ("gensim2.objects.generators.blueprint", "gensim2.objects.generators.generate")


class ArticulatedShelf(Shelf):
    """Base class of the sources of articulated objects."""

    kind: Kind = "articulated"

    def describe(self, asset_class: str) -> str:
        return DESCRIPTIONS.get(asset_class, asset_class.replace("_", " "))


class GeneratedShelf(ArticulatedShelf):
    """Generated objects. Every number up to 10^6 is an id, but ``instances`` lists only the built-in objects."""

    source: Source = "generated"
    license = GENERATED_LICENSE

    def classes(self) -> tuple[str, ...]:
        return tuple(object_classes())

    def instances(self, asset_class: str) -> tuple[str, ...]:
        return tuple(str(i) for i in range(object_classes()[asset_class].count))

    def joint_type(self, asset_class: str) -> str:
        return object_classes()[asset_class].joint_type

    def holds(self, asset_class: str, instance_id: str) -> bool:
        return bool(re.fullmatch(r"0|[1-9][0-9]{0,6}", instance_id)) and int(instance_id) <= LARGEST_NUMBER

    def remedy(self, asset_class: str, instance_id: str) -> str:
        return f"a number from 0 to {LARGEST_NUMBER}"

    def new(self, asset_class: str) -> tuple[str, ...]:
        """Return the ids of new instances, which can be generated but are not among the built-in instances.

        The new ids follow the last built-in instance. Every class has the same number of new instances.
        """
        first = len(self.instances(asset_class))
        return tuple(str(number) for number in range(first, first + NEW))

    def sample(self, asset_class: str, count: int, seed: int) -> tuple[str, ...]:
        """Sample ``count`` different ids (numbers up to 10^6), excluding the built-in instances."""
        first = len(self.instances(asset_class))
        if not 0 <= count <= LARGEST_NUMBER + 1 - first:
            wrong = f"{count} different objects cannot be sampled, because there are only {LARGEST_NUMBER + 1 - first}"
            raise InputError(wrong, field="random")
        drawn = rng(seed, f"sample/{asset_class}").choice(LARGEST_NUMBER + 1 - first, count, replace=False)
        return tuple(str(first + int(number)) for number in sorted(drawn))

    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default") -> ArticulatedObject:
        modules = (*SHARED_MODULES, *GENERATOR_MODULES, *class_modules())
        return prepared(
            f"generated-{asset_class}-{instance_id}-{source_digest(*modules)}",
            lambda folder: _prepare(generate(asset_class, int(instance_id)), folder),
        )


class FolderShelf(ArticulatedShelf):
    """Real objects in the layout of the GenSim2 release: ``<class>/<id>/mobility.urdf`` and ``info.json``.

    Raises:
        AssetError: a folder has an invalid name.
        OSError: the folder cannot be read.
    """

    source: Source = "real"

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._found: dict[str, tuple[str, ...]] = {}
        for class_folder in sorted(p for p in folder.iterdir() if p.is_dir()):
            ids = [p.name for p in class_folder.iterdir() if os.path.lexists(p / URDF)]
            if ids:
                for path in (class_folder, *(class_folder / instance_id for instance_id in ids)):
                    plain_name(path.name, path, "name of the folder")
                self._found[class_folder.name] = tuple(sorted(ids, key=lambda i: (len(i), i)))

    @cached_property
    def license(self) -> str:  # type: ignore[override]
        from gensim2.objects.library.released import license_of

        terms = {license_of(ObjectFolder(self._folder / name / ids[0])) for name, ids in self._found.items()}
        return "; ".join(sorted(terms))

    def classes(self) -> tuple[str, ...]:
        return tuple(sorted(self._found))

    def instances(self, asset_class: str) -> tuple[str, ...]:
        return self._found[asset_class]

    def joint_type(self, asset_class: str) -> str:
        if asset_class in JOINT_TYPES:
            return JOINT_TYPES[asset_class]
        try:
            return self.load(asset_class, self._found[asset_class][0]).joint.type
        except AssetError:
            return "unknown"  # no error is raised here, because ``load`` reports the error when the object is used

    def load(self, asset_class: str, instance_id: str, hulls: Hulls = "default") -> ArticulatedObject:
        from gensim2.objects.library.released import READER_MODULES, read_model

        folder = self._folder / asset_class / instance_id
        print_of_data = ObjectFolder(folder).fingerprint()
        modules = (*SHARED_MODULES, *READER_MODULES)
        key = hashlib.sha256(f"{asset_class}/{instance_id}/{print_of_data}".encode()).hexdigest()[:16]
        rule = "" if hulls == "default" else f"-{hulls}"
        return prepared(
            f"real-{file_name(asset_class)}-{file_name(instance_id)}-{key}-{source_digest(*modules)}{rule}",
            lambda target: _prepare(
                read_model(folder, asset_class, print_of_data, JOINT_TYPES.get(asset_class), hulls), target
            ),
        )


def _prepare(model: Model, folder: Path) -> ArticulatedObject:
    # Import late: listing objects does not need a mesh library.
    from gensim2.objects.library.prepare import prepare

    return prepare(model, folder)

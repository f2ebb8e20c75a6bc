"""Make an HTML page with pictures of every object in one or more libraries, and the failed checks of each object."""

from __future__ import annotations

import hashlib
import io
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gensim2.core.errors import InputError
from gensim2.core.files import write_atomic
from gensim2.core.pages import template
from gensim2.core.plural import plural
from gensim2.core.progress import NULL_PROGRESS, Progress
from gensim2.inspection import pictures
from gensim2.objects.library.catalogue import KINDS, Library
from gensim2.objects.library.folder import ObjectFolder
from gensim2.objects.library.selection import wanted_classes
from gensim2.objects.types import BODY, ArticulatedObject, AssetError, RigidObject

VIEWS = 8
SIZE = 176  # width and height of one view in pixels
WROTE = "give a file that `gensim2 assets validate --json` wrote"
FORMAT_VERSION = "2"  # format of the gallery; after a change all images are drawn again


@dataclass(frozen=True)
class Gallery:
    """Result of ``build_gallery``.

    Attributes:
        index: HTML page; pictures are in ``pictures/`` in the same folder.
        made: number of pictures made.
        kept: number of pictures kept from an earlier run.
        refused: (class, id, reason) of objects that cannot be loaded; they are listed without a picture.
    """

    index: Path
    made: int
    kept: int
    refused: tuple[tuple[str, str, str], ...]


@dataclass
class _Card:
    asset_class: str
    id: str
    picture: str | None
    facts: str
    rows: tuple[str, ...] = ()  # captions of the picture's rows
    keypoints: list[tuple[str, str, str]] = field(default_factory=list)  # name, colour and description of each keypoint
    notes: tuple[str, ...] = ()
    findings: list[dict[str, Any]] | None = None  # None if the object was not validated
    error: str | None = None


def build_gallery(
    libraries: Sequence[Library],
    out: Path,
    *,
    classes: Sequence[str] | None = None,
    findings: Sequence[Path] = (),
    views: int = VIEWS,
    size: int = SIZE,
    progress: Progress = NULL_PROGRESS,
) -> Gallery:
    """Make an HTML page with a turntable picture of every object.

    The picture shows an articulated object at openness 0, 0.5 and 1, and a rigid object at rest.

    Pictures of unchanged objects are kept, so the same call continues an interrupted run.

    Args:
        libraries: object libraries; the page shows each library's articulated objects first.
        out: folder for ``index.html`` and ``pictures/``.
        classes: classes to show; None: all.
        findings: JSON files that ``gensim2 assets validate --json`` wrote.
        views: number of directions from which each object is shown.
        size: width and height of each view in pixels.

    Raises:
        InputError: a class is unknown, folders have the same name, findings are invalid, or the folder is not writable.
        MissingExtraError: SAPIEN is not installed.
        GenSim2Error: no Vulkan driver works on this machine.

    Example:
        ```python
        gallery = build_gallery([gensim2.open_library("builtin")], Path("objects"), classes=["drawer"])
        print(gallery.index)
        ```
    """
    wanted = wanted_classes(libraries, classes)
    verdicts = [_verdicts(path) for path in findings]
    names_of = [library.name for library, _ in wanted]
    if len(set(names_of)) < len(names_of):
        repeated = next(name for name in names_of if names_of.count(name) > 1)
        raise InputError(f"two folders are called {repeated!r}", field="assets", remedy="make a separate page for each")
    maker = _Maker(out, views, size)
    sections = []
    for library, names in wanted:
        for kind in KINDS:
            chosen = [name for name in names if library.kind(name) == kind]
            items = [(name, instance_id) for name in chosen for instance_id in library.instances(name)]
            if not items:
                continue
            cards: list[_Card] = []
            progress.start(f"pictures of {library.name}, {kind} objects", len(items))
            for item in items:
                cards.append(maker.card(library, *item))
                cards[-1].findings = _findings_of(verdicts, library.name, *item)
                progress.advance()
            terms = "; ".join(dict.fromkeys(library.license_of(name) for name in chosen))
            shown = f"{library.name}, rigid" if kind == "rigid" else library.name
            sections.append({"library": shown, "license": terms, "cards": cards, "rigid": kind == "rigid"})
    describe = {name: library.describe(name) for library, names in wanted for name in names}
    page = template("gensim2.inspection", "objects.html.j2").render(
        sections=sections, classes=sorted(describe), describe=describe, views=views, size=size, validated=bool(verdicts)
    )
    write_atomic(out / "index.html", page)
    return Gallery(out / "index.html", maker.made, maker.kept, tuple(maker.refused))


class _Maker:
    """Makes a card (picture and facts) for each object on the page, and draws the pictures that do not exist yet."""

    def __init__(self, out: Path, views: int, size: int) -> None:
        self.made = self.kept = 0
        self.refused: list[tuple[str, str, str]] = []
        self._out, self._views, self._size = out, views, size

    def card(self, library: Library, name: str, instance_id: str) -> _Card:
        try:
            model = library.load(name, instance_id)
        except InputError as error:
            return self._refuse(name, instance_id, error)
        place = f"pictures/{library.name}/{name}/{instance_id}"
        if isinstance(model, RigidObject):
            return _rigid_card(model, self._picture(place, model.folder.name, model))
        return _card(model, self._picture(place, model.urdf.parent.name, model))

    def _refuse(self, asset_class: str, name: str, error: InputError) -> _Card:
        self.refused.append((asset_class, name, str(error)))
        return _Card(asset_class, name, None, "cannot be loaded", error=str(error))

    def _picture(self, place: str, content: str, model: ArticulatedObject | RigidObject) -> str:
        """Return the path of a picture. If the picture is missing, draw it and remove its outdated versions.

        Args:
            content: folder of the prepared object. Its name has digests of the object's files and of the code that
                prepares it.
        """
        text = f"{FORMAT_VERSION}/{self._views}/{self._size}/{content}"
        picture = f"{place}-{hashlib.sha256(text.encode()).hexdigest()[:8]}.webp"
        file = self._out / picture
        if file.is_file():
            self.kept += 1
            return picture
        stream = io.BytesIO()
        pictures.turntable(model, self._views, self._size).save(stream, "WEBP", quality=82, method=4)
        # A looser pattern for object 1 would also match and delete pictures of object 1-2.
        own = re.compile(re.escape(Path(place).name) + r"-[0-9a-f]{8}\.webp")
        for outdated in file.parent.glob("*.webp"):
            if own.fullmatch(outdated.name):
                outdated.unlink()
        write_atomic(file, stream.getvalue())
        self.made += 1
        return picture


def _card(instance: ArticulatedObject, picture: str) -> _Card:
    joint = instance.joint
    unit, scale = ("°", 57.29578) if joint.type == "revolute" else ("mm", 1000.0)
    hulls = sum(len(hulls) for hulls in instance.hulls.values())
    return _Card(
        instance.asset_class,
        instance.id,
        picture,
        f"{joint.type}, {scale * joint.lower:.0f} to {scale * joint.upper:.0f} {unit}, "
        f"{instance.mass:.2g} kg, {_count(hulls)}",
        tuple(f"openness {share:g}" for share in pictures.OPENNESS),
        [
            (pictures.short_name(name), pictures.mark_colour(instance, name), keypoint.description)
            for name, keypoint in sorted(instance.keypoints.items())
        ],
        instance.warnings,
    )


def _count(hulls: int) -> str:
    return plural(hulls, "hull")


def _rigid_card(rigid: RigidObject, picture: str) -> _Card:
    size = " x ".join(f"{1000 * s:.0f}" for s in rigid.size)
    held = f"held at {1000 * rigid.grip.width:.0f} mm"
    return _Card(
        rigid.asset_class,
        rigid.id,
        picture,
        f"{rigid.source}, {size} mm, {1000 * rigid.mass:.0f} g, {_count(len(rigid.hulls[BODY]))}, {held}",
        ("at rest",),
        [
            (pictures.short_name(name), pictures.mark_colour(rigid, name), keypoint.description)
            for name, keypoint in sorted(rigid.keypoints.items())
        ],
        rigid.warnings,
    )


_Verdicts = tuple[str | None, Mapping[tuple[str, str], list[dict[str, Any]]]]


def _verdicts(path: Path) -> _Verdicts:
    """Read findings. Return the name of the library, or None if it is not stated, and the findings by class and id.

    Raises:
        InputError: the file is not from ``gensim2 assets validate --json``.
    """
    file = Path(os.path.realpath(path))
    try:
        value = ObjectFolder(file.parent).read_json(file.name)
    except AssetError as error:
        raise InputError(error.message, file=path, field="--findings", remedy=error.remedy or WROTE) from error
    try:
        found = {(str(entry["class"]), str(entry["id"])): _findings(entry) for entry in value["objects"]}
        library = value.get("library")
    except (KeyError, TypeError, ValueError) as error:
        raise InputError("contains no findings", file=path, field="--findings", remedy=WROTE) from error
    return (str(library) if library else None), found


def _findings(entry: dict[str, Any]) -> list[dict[str, Any]]:
    found = [dict(finding) for finding in entry["findings"]]
    if not all({"check", "value"} <= finding.keys() for finding in found):
        raise KeyError("check")
    return found


def _findings_of(
    verdicts: Sequence[_Verdicts], library: str, asset_class: str, instance_id: str
) -> list[dict[str, Any]] | None:
    for name, found in verdicts:
        if name in (None, library) and (asset_class, instance_id) in found:
            return found[asset_class, instance_id]
    return None

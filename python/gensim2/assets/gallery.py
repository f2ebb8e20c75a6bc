"""A page of pictures of every object of one or more libraries, with what was found wrong with each."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import jinja2

from gensim2.assets import pictures
from gensim2.assets.library import Library
from gensim2.assets.types import Instance
from gensim2.errors import InputError
from gensim2.files import write_atomic
from gensim2.progress import NULL_PROGRESS, Progress

VIEWS = 8
SIZE = 176  # pixels, edge of one view
FORMAT_VERSION = "1"  # of the sheets: another one makes all pictures anew

_TEMPLATES = jinja2.Environment(
    loader=jinja2.PackageLoader("gensim2.assets", "templates"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


@dataclass(frozen=True)
class Gallery:
    """What ``build_gallery`` left behind.

    Attributes:
        index: the page; pictures lie in ``pictures/`` beside it.
        made: pictures made now.
        kept: pictures that were there from an earlier run.
        refused: (class, id, reason) of objects that cannot be loaded; they are on the page without a picture.
    """

    index: Path
    made: int
    kept: int
    refused: tuple[tuple[str, str, str], ...]


@dataclass
class _Card:
    """One object on the page."""

    asset_class: str
    id: str
    picture: str | None
    facts: str
    keypoints: list[tuple[str, str, str]] = field(default_factory=list)  # name, colour, description
    notes: tuple[str, ...] = ()
    findings: list[dict[str, Any]] | None = None  # None: not validated
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
    """Make a static page with a turntable picture of every instance at openness 0, 0.5 and 1.

    A picture that an earlier run made of the same object is kept, so an interrupted run is gone on with by the same
    call.

    Args:
        libraries: whose instances to show.
        out: folder for ``index.html`` and ``pictures/``.
        classes: only these; None: all.
        findings: JSON files of ``gensim2 assets validate --json``.
        views: pictures around an object.
        size: edge of each in pixels.

    Raises:
        InputError: no library has one of ``classes``; a findings file is none; the folder cannot be written to.
        MissingExtraError: SAPIEN is not installed.
        GenSim2Error: no Vulkan driver works here.
    """
    wanted = _wanted(libraries, classes)
    verdicts = [_verdicts(path) for path in findings]
    studio: pictures.Studio | None = None
    made = kept = 0
    refused: list[tuple[str, str, str]] = []
    sections = []
    for library, names in wanted:
        folder = f"pictures/{library.name}"
        cards: list[_Card] = []
        progress.start(f"pictures of {library.name}", sum(len(library.instances(name)) for name in names))
        for name in names:
            for instance_id in library.instances(name):
                try:
                    instance = library.load(name, instance_id)
                except InputError as error:
                    refused.append((name, instance_id, str(error)))
                    cards.append(_Card(name, instance_id, None, "cannot be loaded", error=str(error)))
                    progress.advance()
                    continue
                picture = f"{folder}/{name}/{instance_id}-{_mark_of(instance, views, size)}.webp"
                if (out / picture).is_file():
                    kept += 1
                else:
                    studio = studio or pictures.Studio(size)
                    stream = io.BytesIO()
                    pictures.turntable(studio, instance, views).save(stream, "WEBP", quality=82, method=4)
                    for outdated in (out / picture).parent.glob(f"{instance_id}-*.webp"):
                        outdated.unlink()
                    write_atomic(out / picture, stream.getvalue())
                    made += 1
                cards.append(_card(instance, picture))
                progress.advance()
        for card in cards:
            card.findings = _findings_of(verdicts, library.name, card.asset_class, card.id)
        sections.append({"library": library.name, "license": library.license, "cards": cards})
    page = _TEMPLATES.get_template("gallery.html.j2").render(
        sections=sections,
        classes=sorted({name for _, names in wanted for name in names}),
        describe={name: library.describe(name) for library, names in wanted for name in names},
        openness=[f"{share:g}" for share in pictures.OPENNESS],
        views=views,
        size=size,
        validated=bool(verdicts),
    )
    write_atomic(out / "index.html", page)
    return Gallery(out / "index.html", made, kept, tuple(refused))


def _wanted(libraries: Sequence[Library], classes: Sequence[str] | None) -> list[tuple[Library, tuple[str, ...]]]:
    if classes is None:
        return [(library, library.classes()) for library in libraries]
    known = sorted({name for library in libraries for name in library.classes()})
    for name in classes:
        if name not in known:
            raise InputError(f"no class {name!r}", field="--classes", remedy=f"there are {', '.join(known)}")
    chosen = [(library, tuple(name for name in library.classes() if name in classes)) for library in libraries]
    return [(library, names) for library, names in chosen if names]


def _mark_of(instance: Instance, views: int, size: int) -> str:
    """Eight hex digits of what a picture shows: the prepared object, its folder named by content and code."""
    text = f"{FORMAT_VERSION}/{views}/{size}/{instance.urdf.parent.name}"
    return hashlib.sha256(text.encode()).hexdigest()[:8]


def _card(instance: Instance, picture: str) -> _Card:
    joint = instance.joint
    unit, scale = ("°", 57.29578) if joint.type == "revolute" else ("mm", 1000.0)
    hulls = sum(len(hulls) for hulls in instance.hulls.values())
    return _Card(
        instance.asset_class,
        instance.id,
        picture,
        f"{joint.type}, {scale * joint.lower:.0f} to {scale * joint.upper:.0f} {unit}, "
        f"{instance.mass:.2g} kg, {hulls} hulls",
        [
            (pictures.short_name(name), pictures.mark_colour(instance, name), keypoint.description)
            for name, keypoint in sorted(instance.keypoints.items())
        ],
        instance.warnings,
    )


_Verdicts = tuple[str | None, Mapping[tuple[str, str], list[dict[str, Any]]]]


def _verdicts(path: Path) -> _Verdicts:
    """Name of the library, where the file says it, and findings by (class, id).

    Raises:
        InputError: not a file of ``gensim2 assets validate --json``.
    """
    try:
        value = json.loads(path.read_text())
        found = {(str(entry["class"]), str(entry["id"])): list(entry["findings"]) for entry in value["objects"]}
        library = value.get("library")
    except OSError as error:
        raise InputError(f"cannot read: {error.strerror}", file=path, field="--findings") from error
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(
            "holds no findings",
            file=path,
            field="--findings",
            remedy="give a file that `gensim2 assets validate --json` wrote",
        ) from error
    return (str(library) if library else None), found


def _findings_of(
    verdicts: Sequence[_Verdicts], library: str, asset_class: str, instance_id: str
) -> list[dict[str, Any]] | None:
    for name, found in verdicts:
        if name in (None, library) and (asset_class, instance_id) in found:
            return found[asset_class, instance_id]
    return None

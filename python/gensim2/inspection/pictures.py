"""Draw pictures of objects by ray casting, which needs no graphics driver."""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gensim2.core.arrays import Array
from gensim2.objects.shapes import transform
from gensim2.objects.types import BODY, ArticulatedObject, RigidObject
from gensim2.perception.raycast.drawing import Drawing, fitting_distance
from gensim2.perception.raycast.kinematics import Tree, read_urdf
from gensim2.perception.raycast.shapes import WHITE, Surface, read_links, read_mesh

if TYPE_CHECKING:
    from PIL import Image

View = tuple[float, float]
"""Openness (0 to 1) in a picture, and azimuth of the camera in degrees. 0 is the robot's side, and 90 is its right."""

OPENNESS = (0.0, 0.5, 1.0)
HALF_OPEN = 0.5
ELEVATION = 26.0  # degrees, elevation of the camera above the table
THREE_QUARTER = 32.0  # degrees, azimuth of the camera to the right of the robot's side
MARGIN = 1.04
PAPER, INK = "#ffffff", "#1c2430"
TABLE = (200, 201, 204)
PAINT = ((120, 150, 190), (230, 150, 60))
"""Colours of surfaces without material: of fixed links and rigid objects, and of moving links."""
MARK_COLOURS = ("#d6273a", "#1f6fd1", "#1b8f4c", "#b5661a", "#7b3fb0", "#0f8f99")
HEADER, GAP, CAPTION = 26, 6, 22
"""Height of titles, gap between pictures, and height of the names in a contact sheet, pixels."""


def short_name(keypoint: str) -> str:
    """Return a keypoint's name without the prefix that all keypoints share."""
    return keypoint.removeprefix("articulated_object_").removeprefix("rigidbody_object_")


def mark_colour(model: ArticulatedObject | RigidObject, keypoint: str) -> str:
    """Return the colour of a keypoint in all pictures of an object, as ``#rrggbb``."""
    return MARK_COLOURS[sorted(model.keypoints).index(keypoint) % len(MARK_COLOURS)]


def drawn(
    model: ArticulatedObject | RigidObject,
    views: Sequence[View],
    size: int,
    *,
    marked: bool = True,
    named: bool = False,
) -> list[Image.Image]:
    """Return a picture of an object in its default placement for each view.

    All pictures have the same scale: the object fits each of them. A keypoint is a disc, or a ring if it is hidden.

    Args:
        views: openness and azimuth of each picture; a rigid object has no openness, and ignores the value.
        size: width and height of a picture, pixels.
        marked: whether the pictures show the keypoints.
        named: whether the pictures also show the names of the keypoints.

    Raises:
        InputError: a file of the object cannot be used.
    """
    solids = {openness: _solids(model, openness) for openness, _ in views}
    points = np.concatenate([_points(model, openness, found) for openness, found in solids.items()])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    away = [_towards_camera(azimuth) for _, azimuth in views]
    distance = MARGIN * max(fitting_distance(points - middle, each) for each in away)
    pictures = []
    for (openness, _), direction in zip(views, away, strict=True):
        drawing = Drawing(solids[openness], middle + distance * direction, middle, size)
        for name, place in _keypoints(model, openness).items() if marked else ():
            drawing.point(place, mark_colour(model, name), short_name(name) if named else "")
        pictures.append(drawing.picture())
    return pictures


def turntable(model: ArticulatedObject | RigidObject, views: int, size: int) -> Image.Image:
    """Return views all around an object.

    Each azimuth is a column. Each openness (0, 0.5 and 1) is a row; a rigid object has one row.

    Example:
        ```python
        turntable(gensim2.open_library("builtin").load("drawer", "4711"), views=8, size=176).save("drawer.png")
        ```
    """
    shares = OPENNESS if isinstance(model, ArticulatedObject) else OPENNESS[:1]
    pictures = drawn(model, [(share, azimuth) for share in shares for azimuth in _around(views)], size)
    return _sheet(pictures, views, (size, size))


def strip(model: ArticulatedObject | RigidObject, size: int) -> Image.Image:
    """Return views with labelled keypoints, at openness 0, 0.5 and 1 or from three sides of a rigid object.

    Example:
        ```python
        strip(gensim2.open_library("builtin").load("drawer", "4711"), size=176).save("drawer.png")
        ```
    """
    if isinstance(model, RigidObject):
        views, captions = [(0.0, azimuth) for azimuth in _around(3)], [model.asset_class, "", ""]
    else:
        views = [(openness, THREE_QUARTER) for openness in OPENNESS]
        captions = [f"{openness:g}" for openness in OPENNESS]
        captions[0] = f"{model.asset_class}/{model.id}, openness {captions[0]}"
    gap = 4
    sheet = _sheet(drawn(model, views, size, named=True), len(views), (size + gap, size), (gap, 0), HEADER)
    for column, caption in enumerate(captions):
        _write(sheet, (column * (size + gap) + 6, 4), caption, 15)
    return sheet


def contact_sheet(models: Iterable[ArticulatedObject | RigidObject], columns: int, size: int) -> Image.Image:
    """Return a grid of pictures, one for each object (half open if articulated), each with the name of the class.

    Example:
        ```python
        library = gensim2.open_library("builtin")
        models = [library.load("drawer", str(number)) for number in range(6)]
        contact_sheet(models, columns=3, size=176).save("drawers.png")
        ```
    """
    names, pictures = [], list[Any]()
    for model in models:
        names.append(model.asset_class)
        pictures += drawn(model, [(HALF_OPEN, THREE_QUARTER)], size, marked=False)
    columns, step = min(columns, len(names)), (size + GAP, size + CAPTION + GAP)
    sheet = _sheet(pictures, columns, step, (GAP, GAP))
    for index, name in enumerate(names):
        place = index % columns * step[0] + size / 2, index // columns * step[1] + size + 2
        _write(sheet, place, name, 14, anchor="ma")
    return sheet


def png(picture: Image.Image) -> bytes:
    """Return the content of a PNG file."""
    stream = io.BytesIO()
    picture.save(stream, "PNG")
    return stream.getvalue()


def _sheet(
    pictures: Sequence[Image.Image], columns: int, step: tuple[int, int], gap: tuple[int, int] = (0, 0), top: int = 0
) -> Image.Image:
    """Return pictures in a grid with steps of ``step`` and gaps of ``gap`` pixels, below ``top`` empty rows."""
    from PIL import Image

    rows = -(-len(pictures) // columns)
    sheet = Image.new("RGB", (columns * step[0] - gap[0], top + rows * step[1] - gap[1]), PAPER)
    for index, picture in enumerate(pictures):
        sheet.paste(picture, (index % columns * step[0], top + index // columns * step[1]))
    return sheet


def _write(sheet: Image.Image, place: tuple[float, float], text: str, size: int, anchor: str = "la") -> None:
    from PIL import ImageDraw, ImageFont

    ImageDraw.Draw(sheet).text(place, text, fill=INK, font=ImageFont.load_default(size=size), anchor=anchor)


def _around(views: int) -> list[float]:
    """Return azimuths (degrees) that are evenly spaced around an object; the first one is at the robot's side."""
    return [360.0 * column / views + THREE_QUARTER for column in range(views)]


def _towards_camera(azimuth: float) -> Array:
    """Return the unit vector (3,) from an object to the camera, in the world frame."""
    a, e = np.radians(azimuth), np.radians(ELEVATION)
    return np.array([-np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)])


def _points(model: ArticulatedObject | RigidObject, openness: float, solids: Sequence[tuple[Surface, Array]]) -> Array:
    """Return the vertices of the surfaces and the keypoints (N, 3) in the world frame. ``solids[0]`` is the table."""
    _, *own = solids
    vertices = [transform(pose, surface.vertices.astype(np.float64)) for surface, pose in own]
    return np.concatenate([*vertices, np.array(list(_keypoints(model, openness).values())).reshape(-1, 3)])


def _keypoints(model: ArticulatedObject | RigidObject, openness: float) -> dict[str, Array]:
    """Return the keypoints (3,) in the world frame by name."""
    R, position, found = model.placement.rotation, model.placement.position, {}
    for name, keypoint in model.keypoints.items():
        point = keypoint.position
        if isinstance(model, ArticulatedObject) and keypoint.link == model.joint.child_link:
            point = transform(model.link_pose(openness), point[None])[0]
        found[name] = R @ point + position
    return found


def _solids(model: ArticulatedObject | RigidObject, openness: float) -> list[tuple[Surface, Array]]:
    """Return the surfaces of the table and of the object's links, each with its pose (4, 4) in the world frame."""
    root = np.eye(4)
    root[:3, :3], root[:3, 3] = model.placement.rotation, model.placement.position
    found = [(Surface.box((0.0, 0.0, -0.5), (20.0, 20.0, 0.5), TABLE), np.eye(4))]
    if isinstance(model, RigidObject):
        files = [model.hull_file(index) for index in range(len(model.hulls[BODY]))]
        read = [read_mesh(file) for file in (files if model.visual is None else [model.visual])]
        body = Surface.joined([surface for surface in read if surface is not None])
        return [*found, *([] if body is None else [(_painted(body, PAINT[0]), root)])]
    joint = model.joint
    tree = Tree.of(read_urdf(model.urdf), (joint.name,))
    value = joint.lower + openness * (joint.upper - joint.lower)
    surfaces, poses = read_links(model.urdf), tree.poses(root[None], np.array([[value]]))[0]
    for name, pose in zip(tree.names, poses, strict=True):
        if (surface := surfaces.get(name)) is not None:
            found.append((_painted(surface, PAINT[name == joint.child_link]), pose))
    return found


def _painted(surface: Surface, color: tuple[int, int, int]) -> Surface:
    """Return the surface in another colour if it has neither colours nor textures."""
    bare = bool((surface.colors == WHITE).all()) and not surface.textures
    return surface.painted(color if bare else None)

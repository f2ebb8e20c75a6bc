"""Make pictures of objects with SAPIEN's renderer in a studio: a scene with a table, lamps and a camera."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gensim2.core.errors import GenSim2Error, MissingExtraError
from gensim2.objects.shapes import transform
from gensim2.objects.types import BODY, ArticulatedObject, RigidObject

if TYPE_CHECKING:
    from PIL import Image

Array = npt.NDArray[np.float64]
Pixels = npt.NDArray[np.uint8]

OPENNESS = (0.0, 0.5, 1.0)
HALF_OPEN = 0.5
FIELD_OF_VIEW = np.radians(30)
ELEVATION = 26.0  # degrees, elevation of the camera above the table
THREE_QUARTER = 32.0  # degrees, azimuth of the camera to the right of the robot's side
# images are rendered larger by this factor and then reduced, because SAPIEN's rasterizer does not smooth edges
OVERSAMPLING = 2
MARGIN = 1.04
PAPER, INK = "#ffffff", "#1c2430"
MARK_COLOURS = ("#d6273a", "#1f6fd1", "#1b8f4c", "#b5661a", "#7b3fb0", "#0f8f99")
MARK_RADIUS = 4  # pixels, radius of a keypoint's disc


@dataclass(frozen=True)
class Mark:
    """Position of a keypoint in an image. ``x`` and ``y`` are in pixels from the upper left corner, and ``hidden``
    states whether the keypoint is occluded.
    """

    x: float
    y: float
    hidden: bool


@dataclass(frozen=True)
class Shot:
    """An image (H, W, 3) and the keypoints in it by name."""

    pixels: Pixels
    marks: dict[str, Mark]


def short_name(keypoint: str) -> str:
    """Return a keypoint's name without the prefix that all keypoints share."""
    return keypoint.removeprefix("articulated_object_").removeprefix("rigidbody_object_")


def mark_colour(instance: ArticulatedObject | RigidObject, keypoint: str) -> str:
    """Return the colour of a keypoint in all pictures of an object, as ``#rrggbb``."""
    return MARK_COLOURS[sorted(instance.keypoints).index(keypoint) % len(MARK_COLOURS)]


class Studio:
    """A simulated table with lamps and a camera, for pictures of one object at a time.

    With a software driver, the first picture takes seconds because shaders are compiled; further pictures take tens of
    milliseconds. Therefore use one studio for all pictures.
    """

    def __init__(self, size: int = 200) -> None:
        """Set up the studio.

        Args:
            size: width and height of the pictures, pixels.

        Raises:
            MissingExtraError: SAPIEN is not installed.
            GenSim2Error: no Vulkan driver works on this machine.
        """
        try:
            import sapien

            from gensim2.sim.driver import NO_DRIVER, can_render
        except ImportError as error:
            raise MissingExtraError(error.name or "sapien", "sim") from error
        if not can_render():
            raise GenSim2Error(NO_DRIVER)
        self.size = size
        self._sapien = sapien
        self._scene = sapien.Scene()
        self._scene.set_ambient_light([0.42, 0.42, 0.44])
        self._scene.add_directional_light(
            [0.75, 0.55, -1.2], [1.75, 1.7, 1.6], shadow=True, shadow_scale=1.2, shadow_map_size=1024
        )
        self._scene.add_directional_light([0.4, -0.9, -0.5], [0.55, 0.58, 0.65])
        builder = self._scene.create_actor_builder()
        table = sapien.render.RenderMaterial(base_color=[0.78, 0.79, 0.80, 1], roughness=0.95, specular=0.05)
        builder.add_box_visual(half_size=[20, 20, 0.5], material=table)
        builder.build_kinematic("table").set_pose(sapien.Pose([0, 0, -0.5]))
        pixels = size * OVERSAMPLING
        self._camera = self._scene.add_camera("camera", pixels, pixels, float(FIELD_OF_VIEW), 0.02, 50)
        self._object: Any = None
        self._subject: ArticulatedObject | RigidObject | None = None
        self._center = np.zeros(3)
        self._distance = 1.0

    def put(
        self,
        instance: ArticulatedObject,
        openness: Sequence[float] = OPENNESS,
        azimuths: Sequence[float] = (THREE_QUARTER,),
    ) -> None:
        """Replace the object in the studio by an articulated object in its default placement.

        The camera is placed so that the object fits the picture from all ``azimuths`` (degrees) at all ``openness``
        values.
        """
        self._clear()
        builder = self._scene.create_urdf_loader().parse(str(instance.urdf))[0][0]
        for link in builder.link_builders:
            link.collision_records.clear()
        self._object = builder.build(fix_root_link=True)
        place = instance.placement
        self._object.set_root_pose(self._sapien.Pose(place.position, place.quaternion))
        self._subject = instance
        self._frame(np.concatenate([world_points(instance, share) for share in openness]), azimuths)

    def put_rigid(self, rigid: RigidObject, azimuths: Sequence[float] = (THREE_QUARTER,)) -> None:
        """Replace the object in the studio by a rigid object in its resting pose."""
        self._clear()
        builder = self._scene.create_actor_builder()
        if rigid.visual is not None:
            builder.add_visual_from_file(str(rigid.visual))
        else:
            for index in range(len(rigid.hulls[BODY])):
                builder.add_visual_from_file(str(rigid.hull_file(index)))
        self._object = builder.build_kinematic(rigid.asset_class)
        place = rigid.placement
        self._object.set_pose(self._sapien.Pose(place.position, place.quaternion))
        self._subject = rigid
        points = [*np.concatenate(rigid.hulls[BODY]), *(k.position for k in rigid.keypoints.values())]
        self._frame(np.array(points) @ place.rotation.T + place.position, azimuths)

    def _clear(self) -> None:
        if self._object is None:
            return
        if isinstance(self._subject, ArticulatedObject):
            self._scene.remove_articulation(self._object)
        else:
            self._scene.remove_actor(self._object)
        self._object = self._subject = None

    def _frame(self, points: Array, azimuths: Sequence[float]) -> None:
        """Place the camera so that points (N, 3) in the world frame fit the picture."""
        self._center = (points.min(axis=0) + points.max(axis=0)) / 2
        self._distance = MARGIN * max(_clear_distance(points - self._center, azimuth) for azimuth in azimuths)

    def shoot(self, openness: float = 0.0, azimuth: float = THREE_QUARTER, elevation: float = ELEVATION) -> Shot:
        """Return a picture of the object in the studio.

        Args:
            openness: 0 to 1.
            azimuth: degrees around the object; 0 is the robot's side, 90 the robot's right.
            elevation: degrees above the table.
        """
        subject = self._subject
        if subject is None:
            raise ValueError("the studio contains no object; call put or put_rigid first")
        if isinstance(subject, ArticulatedObject):
            joint = subject.joint
            self._object.set_qpos(np.array([joint.lower + openness * (joint.upper - joint.lower)], np.float32))
        R, eye = camera_pose(self._center, self._distance, azimuth, elevation)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R, eye
        self._camera.entity.set_pose(self._sapien.Pose(T.astype(np.float32)))
        self._scene.update_render()
        self._camera.take_picture()
        colour = np.clip(self._camera.get_picture("Color")[..., :3], 0, 1)
        depth = -self._camera.get_picture("Position")[..., 2]
        from PIL import Image

        large = Image.fromarray((255 * colour).astype(np.uint8))
        pixels = np.asarray(large.resize((self.size, self.size), Image.Resampling.BOX))
        marks = {name: self._mark(point, R, eye, depth) for name, point in keypoints_at(subject, openness).items()}
        return Shot(pixels, marks)

    def _mark(self, point: Array, R: Array, eye: Array, depth: Array) -> Mark:
        ahead, left, up = R.T @ (point - eye)
        focal = 0.5 * self.size / float(np.tan(FIELD_OF_VIEW / 2))
        x, y = self.size / 2 - focal * left / ahead, self.size / 2 - focal * up / ahead
        column, row = (int(np.clip(OVERSAMPLING * v, 0, depth.shape[0] - 1)) for v in (x, y))
        seen = float(depth[row, column])
        return Mark(float(x), float(y), hidden=0 < seen < ahead - 0.02)


def camera_pose(center: Array, distance: float, azimuth: float, elevation: float) -> tuple[Array, Array]:
    """Return the rotation (3, 3) and the position (3,) of a camera that looks at ``center``.

    The columns of the rotation are the forward, left and up directions of the camera.
    """
    a, e = np.radians(azimuth), np.radians(elevation)
    ahead = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), -np.sin(e)])
    left = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.column_stack([ahead, left, np.cross(ahead, left)]), center - distance * ahead


def _clear_distance(points: Array, azimuth: float) -> float:
    """Return the smallest distance (m) between a camera and its target at which the camera sees all points. The points
    (N, 3) are given relative to the target, which is the point at which the camera looks.
    """
    R, _ = camera_pose(np.zeros(3), 0.0, azimuth, ELEVATION)
    ahead, left, up = R.T @ points.T
    return float((np.maximum(np.abs(left), np.abs(up)) / np.tan(FIELD_OF_VIEW / 2) - ahead).max())


def world_points(instance: ArticulatedObject, openness: float) -> Array:
    """Return hull vertices and keypoints (N, 3) in the world frame."""
    R, position = instance.placement.rotation, instance.placement.position
    T = instance.link_pose(openness)
    child = instance.joint.child_link
    points = [transform(T, hull) if link == child else hull for link, hulls in instance.hulls.items() for hull in hulls]
    in_root = np.concatenate(points) @ R.T + position
    return np.concatenate([in_root, np.array(list(keypoints_at(instance, openness).values())).reshape(-1, 3)])


def keypoints_at(instance: ArticulatedObject | RigidObject, openness: float) -> dict[str, Array]:
    """Return the keypoints (3,) in the world frame by name."""
    if isinstance(instance, RigidObject):
        place = instance.placement
        return {
            name: place.rotation @ keypoint.position + place.position for name, keypoint in instance.keypoints.items()
        }
    R, position = instance.placement.rotation, instance.placement.position
    T = instance.link_pose(openness)
    found = {}
    for name, keypoint in instance.keypoints.items():
        point = keypoint.position
        if keypoint.link == instance.joint.child_link:
            point = transform(T, point[None])[0]
        found[name] = R @ point + position
    return found


def annotated(shot: Shot, instance: ArticulatedObject | RigidObject, names: bool) -> Image.Image:
    """Return the picture with the keypoints drawn into it: visible keypoints as discs, and occluded keypoints as rings.
    If ``names`` is true, the picture also shows the names of the keypoints.
    """
    from PIL import Image, ImageDraw, ImageFont

    picture = Image.fromarray(shot.pixels)
    factor = 4  # the marks are drawn larger by this factor and then reduced, because PIL does not smooth edges
    layer = Image.new("RGBA", (factor * picture.width, factor * picture.height), (0, 0, 0, 0))
    draw = ImageDraw.Draw(layer)
    for name, mark in shot.marks.items():
        colour = mark_colour(instance, name)
        for radius, ink in ((MARK_RADIUS + 1.5, "#ffffff"), (MARK_RADIUS, colour)):
            r = factor * radius
            x, y = factor * mark.x, factor * mark.y
            box = (x - r, y - r, x + r, y + r)
            if mark.hidden:
                draw.ellipse(box, outline=ink, width=int(factor * (2.5 if ink == "#ffffff" else 2)))
            else:
                draw.ellipse(box, fill=ink)
    layer = layer.resize(picture.size, Image.Resampling.LANCZOS)
    picture.paste(layer, mask=layer)
    if names:
        text = ImageDraw.Draw(picture)
        font = ImageFont.load_default(size=13)
        taken: list[tuple[float, float, float, float]] = []
        for name, mark in sorted(shot.marks.items(), key=lambda item: item[1].y):
            label = short_name(name)
            width = text.textlength(label, font=font)
            x = min(mark.x + 9, picture.width - width - 3)
            y = mark.y - 8
            while any(abs(y - other[1]) < 15 and x < other[2] and x + width > other[0] for other in taken):
                y += 4
            taken.append((x, y, x + width, y + 15))
            text.text((x, y), label, fill=mark_colour(instance, name), font=font, stroke_width=2, stroke_fill="#ffffff")
    return picture


def turntable(studio: Studio, instance: ArticulatedObject, views: int) -> Image.Image:
    """Return views of an articulated object on one sheet: a row for each openness, a column for each azimuth.

    Example:
        ```python
        turntable(Studio(176), gensim2.open_library("builtin").load("drawer", "4711"), views=8).save("drawer.png")
        ```
    """
    from PIL import Image

    azimuths = [360.0 * column / views + THREE_QUARTER for column in range(views)]
    studio.put(instance, azimuths=azimuths)
    sheet = Image.new("RGB", (views * studio.size, len(OPENNESS) * studio.size), PAPER)
    for row, openness in enumerate(OPENNESS):
        for column, azimuth in enumerate(azimuths):
            shot = studio.shoot(openness, azimuth)
            sheet.paste(annotated(shot, instance, names=False), (column * studio.size, row * studio.size))
    return sheet


def rigid_turntable(studio: Studio, rigid: RigidObject, views: int) -> Image.Image:
    """Return views of a rigid object from all around in one row. The first view is taken from the robot's side."""
    from PIL import Image

    azimuths = [360.0 * column / views + THREE_QUARTER for column in range(views)]
    studio.put_rigid(rigid, azimuths)
    sheet = Image.new("RGB", (views * studio.size, studio.size), PAPER)
    for column, azimuth in enumerate(azimuths):
        sheet.paste(annotated(studio.shoot(azimuth=azimuth), rigid, names=False), (column * studio.size, 0))
    return sheet


def strip(studio: Studio, model: ArticulatedObject | RigidObject) -> Image.Image:
    """Return views with labelled keypoints: an articulated object at openness 0, 0.5 and 1, or a rigid object from
    three sides.

    Example:
        ```python
        strip(Studio(176), gensim2.open_library("builtin").load("drawer", "4711")).save("drawer.png")
        ```
    """
    from PIL import Image, ImageDraw, ImageFont

    if isinstance(model, RigidObject):
        azimuths = [360.0 * column / 3 + THREE_QUARTER for column in range(3)]
        studio.put_rigid(model, azimuths)
        shots = [(studio.shoot(azimuth=azimuth), "") for azimuth in azimuths]
        title = model.asset_class
    else:
        studio.put(model)
        shots = [(studio.shoot(openness), f"{openness:g}") for openness in OPENNESS]
        title = f"{model.asset_class}/{model.id}, openness {shots[0][1]}"
    header = 26
    sheet = Image.new("RGB", (len(shots) * (studio.size + 4) - 4, studio.size + header), PAPER)
    draw = ImageDraw.Draw(sheet)
    for column, (shot, caption) in enumerate(shots):
        left = column * (studio.size + 4)
        sheet.paste(annotated(shot, model, names=True), (left, header))
        draw.text((left + 6, 4), caption if column else title, fill=INK, font=ImageFont.load_default(size=15))
    return sheet


def contact_sheet(studio: Studio, models: Iterable[ArticulatedObject | RigidObject], columns: int) -> Image.Image:
    """Return a grid of pictures, one for each object (half open if articulated), each with the name of the class.

    Example:
        ```python
        library = gensim2.open_library("builtin")
        models = [library.load("drawer", str(number)) for number in range(6)]
        contact_sheet(Studio(176), models, columns=3).save("drawers.png")
        ```
    """
    from PIL import Image, ImageDraw, ImageFont

    caption, gap = 22, 6
    tiles: list[tuple[str, Pixels]] = []
    for model in models:
        if isinstance(model, RigidObject):
            studio.put_rigid(model)
            tiles.append((model.asset_class, studio.shoot().pixels))
        else:
            studio.put(model, [HALF_OPEN])
            tiles.append((model.asset_class, studio.shoot(HALF_OPEN).pixels))
    columns = min(columns, len(tiles))
    rows = -(-len(tiles) // columns)
    step_x, step_y = studio.size + gap, studio.size + caption + gap
    sheet = Image.new("RGB", (columns * step_x - gap, rows * step_y - gap), PAPER)
    draw = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(size=14)
    for index, (name, pixels) in enumerate(tiles):
        left, top = index % columns * step_x, index // columns * step_y
        sheet.paste(Image.fromarray(pixels), (left, top))
        width = draw.textlength(name, font=font)
        draw.text((left + (studio.size - width) / 2, top + studio.size + 2), name, fill=INK, font=font)
    return sheet

"""Generate object instances, each fully determined by its class and number."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

import numpy as np

from gensim2.core.arrays import Array
from gensim2.core.seeding import rng
from gensim2.objects.generators.blueprint import Blueprint
from gensim2.objects.generators.classes import object_classes
from gensim2.objects.model import LinkGeometry, Model
from gensim2.objects.shapes import Solid, pose, transform
from gensim2.objects.types import Keypoint

LICENSE = "Apache-2.0"

# Pose of the model frame (y up, z to the front) in the root frame (z up, -x to the front), as in PartNet-Mobility.
T_ROOT_MODEL = np.array([[0.0, 0, -1, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])


def blueprint(asset_class: str, number: int) -> Blueprint:
    """Return the random blueprint of instance ``number`` of a class."""
    known = object_classes()[asset_class]
    makes = (known.build, *known.others) if number >= known.count else (known.build,)
    build = makes[int(rng(0, f"assets/{asset_class}/make", number).integers(len(makes)))]
    return build(rng(0, f"assets/{asset_class}", number))


def blueprint_hash(asset_class: str, number: int, drawn: Blueprint) -> str:
    """Return the hex digest of a blueprint's geometry, rounded to 1 nm so that it is the same on every machine."""
    digest = hashlib.sha256(f"{asset_class}/{number}".encode())

    def add(values: object) -> None:
        rounded = np.round(np.asarray(values, float) * 1e9) + 0.0
        digest.update(rounded.astype(np.int64).tobytes())

    def add_solids(solids: Iterable[Solid]) -> None:
        for solid in solids:
            if solid.hull is not None:
                add(solid.hull)
            if solid.mesh is not None:
                add(solid.mesh.vertices)
                add([*solid.mesh.look.rgba, solid.mesh.look.metallic, solid.mesh.look.roughness])

    add_solids(drawn.body)
    add_solids(drawn.moving)
    add(drawn.joint_origin)
    add(drawn.joint_axis)
    add(drawn.limits)
    for name, (position, description) in sorted(drawn.keypoints.items()):
        digest.update(f"{name}: {description}".encode())
        add(position)
    return digest.hexdigest()


def _geometry(solids: list[Solid], T: Array) -> LinkGeometry:
    moved = [solid.moved(T) for solid in solids]
    return LinkGeometry([s.hull for s in moved if s.hull is not None], [s.mesh for s in moved if s.mesh is not None])


def from_blueprint(asset_class: str, number: int, drawn: Blueprint, content_hash: str, license: str) -> Model:
    """Convert a blueprint to a model of an object."""
    origin = np.asarray(drawn.joint_origin, float)
    axis = np.asarray(drawn.joint_axis, float) / np.linalg.norm(drawn.joint_axis)
    T_link_model = pose(-origin)
    keypoints = {}
    for name, (position, description) in drawn.keypoints.items():
        p = np.asarray(position, float)[None]
        if "base" in name:
            keypoints[name] = Keypoint("base", transform(T_ROOT_MODEL, p)[0], description)
        else:
            keypoints[name] = Keypoint("link_0", transform(T_link_model, p)[0], description)
    return Model(
        asset_class=asset_class,
        id=str(number),
        source="generated",
        body=_geometry(drawn.body, T_ROOT_MODEL),
        moving=_geometry(drawn.moving, T_link_model),
        joint_name="joint_0",
        joint_type=drawn.joint_type,
        moving_link="link_0",
        T_root_link=T_ROOT_MODEL @ pose(origin),
        axis=axis,
        lower=float(drawn.limits[0]),
        upper=float(drawn.limits[1]),
        keypoints=keypoints,
        T_link_object=T_link_model,
        object_axis=drawn.object_axis,
        content_hash=content_hash,
        license=license,
    )


def generate(asset_class: str, number: int) -> Model:
    """Return the model of instance ``number`` of a class."""
    drawn = blueprint(asset_class, number)
    return from_blueprint(asset_class, number, drawn, blueprint_hash(asset_class, number, drawn), LICENSE)

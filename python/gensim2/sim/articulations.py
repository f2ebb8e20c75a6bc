"""Articulations from URDFs in a scene of SAPIEN's own, without ManiSkill and without pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sapien
from mani_skill.utils import sapien_utils
from sapien import physx
from sapien.wrapper.articulation_builder import ArticulationBuilder
from sapien.wrapper.urdf_loader import URDFLoader


def parsed(urdf: str, config: Mapping[str, Any] | None = None) -> ArticulationBuilder:
    """A builder of the articulation that a URDF describes, its root fixed.

    Args:
        urdf: path of the file.
        config: materials of links, as ManiSkill's agents have them.
    """
    loader = URDFLoader()
    # The loader wants a scene for its builders only; a parsed builder builds into any.
    loader.set_scene(sapien.Scene([physx.PhysxCpuSystem()]))
    loader.fix_root_link = True
    if config is not None:
        sapien_utils.apply_urdf_config(loader, sapien_utils.parse_urdf_config(config))
    build_link = loader._build_link

    def without_visuals(link: Any, builder: Any) -> None:
        link.visuals = []
        build_link(link, builder)

    loader._build_link = without_visuals
    articulations, _, _ = loader.parse(urdf)
    builder: ArticulationBuilder = articulations[0]
    return builder


def built(builder: ArticulationBuilder, scene: sapien.Scene, pose: sapien.Pose) -> physx.PhysxArticulation:
    """Build into ``scene`` with the root at ``pose`` in the world."""
    builder.set_scene(scene)
    builder.set_initial_pose(pose)
    articulation: physx.PhysxArticulation = builder.build()
    articulation.pose = pose
    return articulation

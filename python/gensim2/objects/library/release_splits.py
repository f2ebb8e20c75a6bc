"""Named splits of the released classes, from ``release_splits.yaml`` beside this file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files

from gensim2.core.yaml_files import parse_yaml


def release_split(asset_class: str, name: str, listed: Sequence[str]) -> tuple[str, ...] | None:
    """Return the ids of a named split of a class.

    Args:
        asset_class: name of the class.
        name: of the split.
        listed: ids that a library has of the class.

    Returns:
        None where the class has no such split; all of ``listed`` where the library is no copy of the release, which is
        to say, lacks ids of the split: what suits a task is known of the released objects only.
    """
    split = _splits().get(asset_class, {}).get(name)
    if split is None:
        return None
    return tuple(i for i in listed if i in split) if set(split) <= set(listed) else tuple(listed)


@cache
def _splits() -> Mapping[str, Mapping[str, Sequence[str]]]:
    source = files("gensim2.objects.library") / "release_splits.yaml"
    found: Mapping[str, Mapping[str, Sequence[str]]] = parse_yaml(source.read_bytes(), str(source))
    return found

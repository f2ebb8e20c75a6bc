"""Put hostile texts into every field of a folder's files that takes free text."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml

from gensim2.core.errors import InputError

Place = tuple[str | int, ...]


def texts(value: Any, place: Place = ()) -> Iterator[tuple[Place, bool]]:
    """Yield the place of each text in plain data, and whether it is a key; of similar entries of a list, the first."""
    if isinstance(value, str):
        yield place, False
    elif isinstance(value, dict):
        for key, each in value.items():
            yield (*place, key), True
            yield from texts(each, (*place, key))
    elif isinstance(value, list) and value:
        yield from texts(value[0], (*place, 0))


def replaced(value: Any, place: Place, is_key: bool, text: str) -> Any:
    """Return plain data with the text at a place replaced."""
    if not place:
        return text
    (first, *rest), copy = place, value.copy()
    if is_key and not rest:
        return value if text in value else {text if key == first else key: each for key, each in value.items()}
    copy[first] = replaced(value[first], tuple(rest), is_key, text)
    return copy


def made_hostile(folder: Path, candidates: Sequence[str], read: Callable[[], object]) -> list[str]:
    """Put the first text that ``read`` accepts into each field of JSON, JSON lines and YAML files.

    Returns:
        The fields that have one now.
    """
    found = []
    for path in sorted(folder.rglob("*")):
        if path.suffix not in (".json", ".jsonl", ".yaml"):
            continue
        lines = [path.read_text()] if path.suffix != ".jsonl" else path.read_text().splitlines()
        now = yaml.safe_load(lines[0])
        for place, is_key in sorted(texts(now), key=lambda found: (found[1], -len(found[0]))):  # outer keys last
            before = path.read_bytes()
            for text in candidates:
                tried = replaced(now, place, is_key, text)
                told = yaml.safe_dump(tried) if path.suffix == ".yaml" else json.dumps(tried)
                path.write_text("\n".join([told, *lines[1:]]) + "\n")
                try:
                    read()
                except InputError:
                    path.write_bytes(before)
                else:
                    now = tried
                    found.append(f"{path.relative_to(folder)}: {'.'.join(map(str, place))}")
                    break
    return found

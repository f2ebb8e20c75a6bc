"""Read an object's files: only regular files of bounded size inside its folder are opened."""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gensim2.core.files import user_folder
from gensim2.core.foreign.limits import MAX_OBJECT, MAX_OBJECT_FILES, MAX_OBJECT_JSON
from gensim2.core.foreign.tree import ForeignTree, megabytes, shortened
from gensim2.objects.types import AssetError, MissingFileError

MODELS = (".urdf", ".xml", ".mjcf", ".usd", ".usda", ".usdc", ".usdz")
"""Suffixes of the files that an import reads."""


@dataclass(frozen=True)
class ObjectFolder(ForeignTree):
    """Folder of one object. The folder itself may be a link, but links in it must not lead outside."""

    ERROR = AssetError
    MISSING = MissingFileError
    MAX_FILES = MAX_OBJECT_FILES

    def read_json(self, name: str) -> dict[str, Any]:
        """Return the JSON object in a file.

        Raises:
            MissingFileError: the file does not exist.
            AssetError: the file is not a JSON object, or repeats a field.
        """
        content, file = self.read(name, MAX_OBJECT_JSON), self.path / name
        try:
            value = json.loads(content.decode(), object_pairs_hook=_each_once)
        except RecursionError as error:
            raise AssetError("not JSON: nested too deeply", file=file) from error
        except ValueError as error:
            raise AssetError(f"not JSON: {error}", file=file) from error
        if not isinstance(value, dict):
            raise AssetError("holds no fields", file=file, remedy='write {"field": value, ...}')
        return value

    def fingerprint(self) -> str:
        """Return the hex digest of the names and contents of all regular files, and the names of all other entries.

        Raises:
            AssetError: the files are too many or too large, or a file cannot be read.
        """
        digest, names = hashlib.sha256(), self.names()
        if sum((self.path / name).lstat().st_size for name in names) > MAX_OBJECT:
            remedy = "remove files that do not belong there"
            raise AssetError(f"holds over {megabytes(MAX_OBJECT)}", file=self.path, remedy=remedy)
        for name in names:
            digest.update(os.fsencode(name))
            if self.has(name):
                digest.update(self.read(name, MAX_OBJECT))
        return digest.hexdigest()


def existing_folder(where: Path | str, field: str | None = None, remedy: str | None = None) -> Path:
    """Return the folder that a user named, with ``~`` expanded.

    Raises:
        AssetError: the folder does not exist.
    """
    try:
        folder = Path(where).expanduser()
        if str(where) and folder.is_dir():
            return folder
    # These errors are raised for paths that are too long, for NUL characters, and for ``~`` with an unknown user.
    except (OSError, RuntimeError, ValueError):
        folder = Path(shortened(str(where)))
    raise AssetError("no such folder", file=folder if str(where) else '""', field=field, remedy=remedy)


def _each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    value = dict(pairs)
    if len(value) != len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"field {twice[:40]!r} is repeated")
    return value


def maniskill_data() -> Path:
    """Return the folder of ManiSkill's downloads: ``$MS_ASSET_DIR/data``.

    Raises:
        InputError: ``MS_ASSET_DIR`` is not set, and the account has no home folder.
    """
    return user_folder("MS_ASSET_DIR", lambda: Path.home() / ".maniskill") / "data"


def find_source(where: str) -> Path:
    """Return the path of an object to import.

    The object is a URDF, MJCF or USD file, or the folder of a PartNet-Mobility model.

    Args:
        where: path of the file or the folder, or number of a PartNet-Mobility model that ManiSkill has downloaded.

    Raises:
        InputError: there is no such file, folder or model.
    """
    try:
        file = Path(where).expanduser()
        if file.suffix in MODELS and not file.is_dir():
            return file
    except (OSError, RuntimeError, ValueError):
        pass  # the code below reports that ``where`` is not a valid path
    try:
        return existing_folder(where)
    except AssetError as error:
        models = maniskill_data() / "partnet_mobility" / "dataset"
        if re.fullmatch(r"[0-9]{1,12}", where) and (models / where).is_dir():
            return models / where
        remedy = f"give a URDF, MJCF or USD file, a PartNet-Mobility folder, or the number of one in {models}"
        raise AssetError(error.message, file=error.file, remedy=remedy) from error

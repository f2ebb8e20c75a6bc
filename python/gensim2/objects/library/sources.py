"""Sources of models for ``gensim2 assets import``."""

from __future__ import annotations

import re
from pathlib import Path

from gensim2.core.files import user_folder
from gensim2.objects.errors import AssetError
from gensim2.objects.library.folder import existing_folder


def maniskill_data() -> Path:
    """Return the folder of ManiSkill's downloads: ``$MS_ASSET_DIR/data``.

    Raises:
        InputError: the variable is not set, and the account has no home folder.
    """
    return user_folder("MS_ASSET_DIR", lambda: Path.home() / ".maniskill") / "data"


def find_source(where: str) -> Path:
    """Folder of a PartNet-Mobility model: a path, or the number of one that ManiSkill has downloaded.

    Raises:
        InputError: neither is there.
    """
    try:
        return existing_folder(where)
    except AssetError as error:
        models = maniskill_data() / "partnet_mobility" / "dataset"
        if re.fullmatch(r"[0-9]{1,12}", where) and (models / where).is_dir():
            return models / where
        remedy = f"give a PartNet-Mobility folder, or the number of one in {models}"
        raise AssetError(error.message, file=error.file, remedy=remedy) from error

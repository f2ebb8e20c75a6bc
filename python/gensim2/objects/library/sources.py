"""Sources of models for ``gensim2 assets import``."""

from __future__ import annotations

import os
import re
from pathlib import Path

from gensim2.objects.errors import AssetError
from gensim2.objects.library.folder import existing_folder


def find_source(where: str) -> Path:
    """Folder of a PartNet-Mobility model: a path, or the number of one that ManiSkill has downloaded.

    Raises:
        InputError: neither is there.
    """
    root = Path(os.environ.get("MS_ASSET_DIR") or Path.home() / ".maniskill")
    models = root / "data" / "partnet_mobility" / "dataset"
    try:
        return existing_folder(where, remedy=f"give a PartNet-Mobility folder, or the number of one in {models}")
    except AssetError:
        if re.fullmatch(r"[0-9]{1,12}", where) and (models / where).is_dir():
            return models / where
        raise

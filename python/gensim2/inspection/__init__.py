"""Check objects and make pictures of them. Without the simulator SAPIEN, checks are limited to the geometry."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gensim2.core.lazy import lazy_names

if TYPE_CHECKING:
    from gensim2.inspection.checks import Finding
    from gensim2.inspection.gallery import build_gallery
    from gensim2.inspection.pictures import contact_sheet, strip, turntable
    from gensim2.inspection.validate import ObjectReport, check_object

__all__ = ["Finding", "ObjectReport", "build_gallery", "check_object", "contact_sheet", "strip", "turntable"]

__getattr__ = lazy_names(__name__)

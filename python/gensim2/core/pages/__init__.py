"""Pages of the project: rooms bring their templates, this brings what all pages share, their look above all."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Template


@cache
def template(package: str, name: str) -> Template:
    """A template in ``templates/`` of a package; it may extend ``base.html.j2`` and import ``parts.html.j2``.

    Every page is one file that loads nothing from elsewhere but what lies beside it.
    """
    import jinja2  # here: refusing arguments needs no page

    templates = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(package), jinja2.PackageLoader("gensim2.core.pages")]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["openness"] = _openness
    templates.filters["share"] = _share
    return templates.get_template(name)


def _openness(value: float | None) -> str:
    return "no number" if value is None else f"{value:.2f}"


def _share(value: Any) -> str:
    """A rate with two digits."""
    return f"{float(value):.2f}"

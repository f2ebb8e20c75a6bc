"""Render HTML pages: this package has the common layout and style, and other packages add their own templates."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from gensim2.core.errors import printable
from gensim2.core.plural import plural

if TYPE_CHECKING:
    from jinja2 import Template


@cache
def template(package: str, name: str) -> Template:
    """Return a template from the folder ``templates/`` of a package.

    Templates may use ``base.html.j2`` and ``parts.html.j2``. Pages load other files only from their own folder.
    """
    import jinja2  # import late, because checking arguments does not need this module

    templates = jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(package), jinja2.PackageLoader("gensim2.core.pages")]),
        autoescape=True,
        finalize=_visible,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["openness"] = _openness
    templates.filters["share"] = _share
    templates.filters["plural"] = plural
    return templates.get_template(name)


def _visible(value: Any) -> Any:
    """Convert a value to safe text.

    Control characters become escape sequences, and True, False and None become yes, no and none.
    """
    if value is None or isinstance(value, bool):
        return {None: "none", True: "yes", False: "no"}[value]
    # A template macro has already replaced the control characters in values of type Markup.
    return printable(value) if type(value) is str else value


def _openness(value: float | None) -> str:
    return "no number" if value is None else f"{value:.2f}"


def _share(value: Any) -> str:
    return f"{float(value):.2f}"

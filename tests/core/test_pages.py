"""HTML pages show words instead of Python's values."""

from __future__ import annotations

from gensim2.core.pages import template


def test_python_values_are_words() -> None:
    environment = template("gensim2.data", "collection.html.j2").environment
    page = environment.from_string("{% for each in values %}{{ each }} {% endfor %}")
    assert page.render(values=[True, False, None, 0, 1, "None"]) == "yes no none 0 1 None "

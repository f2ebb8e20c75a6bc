"""Counts in messages and on pages are singular only for one."""

from __future__ import annotations

from gensim2.core.pages import template
from gensim2.core.plural import plural


def test_only_one_is_singular() -> None:
    assert [plural(count, "video") for count in (0, 1, 2)] == ["0 videos", "1 video", "2 videos"]


def test_pages_have_the_same_words() -> None:
    environment = template("gensim2.data", "collection.html.j2").environment
    assert environment.from_string("{{ 1 | plural('task') }}").render() == "1 task"

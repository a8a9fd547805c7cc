"""A section of the reproduction: one question, measured, drawn and checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import attrs
from matplotlib.figure import Figure

# What a section measured: numbers, strings, lists and mappings, as JSON holds them.
Result = dict[str, Any]
# Receives the share of the work that is done, from 0 to 1, never less than before.
Tell = Callable[[float], None]


@attrs.frozen(kw_only=True)
class Section:
    """
    One experiment of the reproduction.

    Attributes
    ----------
    name
        Key of its result in paper.json and stem of its files: a Python identifier.
    title
        Heading of the article.
    measure
        ``measure(tell, jobs)`` runs it on up to ``jobs`` processors. The result depends neither
        on ``jobs`` nor on anything else than the seeds and scenarios that the section declares.
    figures
        ``figures(result)`` draws a result, also one read back from JSON; by file stem.
    check
        ``check(result)`` returns a sentence for each number out of the tolerance that the section
        declares, none if all is well.
    quick
        The same measurement on a smaller scale, of the same form, for a first look in a few
        seconds; None where ``measure`` is quick already. Its result is not checked.

    """

    name: str
    title: str
    measure: Callable[[Tell, int], Result]
    figures: Callable[[Result], dict[str, Figure]]
    check: Callable[[Result], list[str]]
    quick: Callable[[Tell, int], Result] | None = None

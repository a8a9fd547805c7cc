"""What the article says about each section."""

from __future__ import annotations

from collections.abc import Callable

from nadrc_ros.paper import prose_comparison, prose_parts
from nadrc_ros.paper.markup import Prose
from nadrc_ros.paper.section import Result

PROSE: dict[str, Callable[[Result], Prose]] = {
    'table1': prose_comparison.table1,
    'figures34': prose_comparison.figures34,
    'attribution': prose_comparison.attribution,
    'fair': prose_comparison.fair,
    'bounds': prose_parts.bounds,
    'rates': prose_parts.rates,
    'differentiator': prose_parts.differentiator,
    'startup': prose_parts.startup,
}

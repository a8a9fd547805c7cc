"""What keeps a log readable, and true to its last line."""

from __future__ import annotations

from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.nodes.mode_log import COUNT, ModeLog, SECONDS

LOST = Mode.HOLDING, Cause.MEASUREMENT_TIMEOUT
FINE = Mode.OK, Cause.NONE


def flapping(times: int) -> tuple[ModeLog, list[str]]:
    news = ModeLog(*FINE)
    return news, [news.of(*(FINE if i % 2 else LOST), 0.01 * i) for i in range(times)]


def test_p19_each_change_is_told_once() -> None:
    news = ModeLog(Mode.SAFE, Cause.START)
    assert news.of(Mode.SAFE, Cause.START, 0.0) == ''
    assert news.of(*FINE, 0.1) == 'in control'
    assert news.of(*FINE, 0.2) == ''
    assert news.of(*LOST, 0.3) == 'holding: no valid measurement'
    assert news.of(Mode.HOLDING, Cause.NONE, 0.4) == 'holding: restarting'


def test_p20_what_flaps_is_told_so_many_times_and_then_counted() -> None:
    news, told = flapping(COUNT + 10)
    assert [bool(line) for line in told] == [True] * COUNT + [False] * 10
    later = news.of(*LOST, SECONDS + 0.005)
    assert later == 'holding: no valid measurement (after 10 changes that were not logged)'
    assert news.of(*FINE, SECONDS + 0.007) == ''  # only the first of the others is so old


def test_p19_the_last_of_many_changes_is_told_though_nothing_changes_any_more() -> None:
    news, told = flapping(COUNT + 1)
    assert told[COUNT - 1] == 'in control' and told[COUNT] == ''
    assert news.of(*LOST, SECONDS - 1.0) == ''
    assert news.of(*LOST, SECONDS) == 'holding: no valid measurement'
    assert news.of(*LOST, SECONDS + 1.0) == ''

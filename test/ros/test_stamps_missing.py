"""Lost samples, found by the numbers of those that came."""

from __future__ import annotations

from nadrc_ros.ros.stamps import Losses
import pytest


def test_losses_are_the_numbers_between_a_sample_and_the_one_before_of_its_publisher() -> None:
    losses = Losses()
    assert losses.newest == 0
    assert [losses.before(number) for number in (5, 6, 9, 10)] == [0, 0, 2, 0]
    assert [losses.before(number) for number in (1, 2, 3)] == [0, 0, 0]  # it was restarted
    # from now on two publishers, in turns
    assert [losses.before(number) for number in (11, 4, 13, 5)] == [0, 0, 1, 0]
    assert losses.newest == 5 and not losses.unknown
    assert losses.before(None) == 0 and losses.unknown


@pytest.mark.parametrize(('publishers', 'first'), [(8, 1), (9, 1001)])
def test_eight_publishers_are_followed_and_of_more_the_last_ones(
    publishers: int, first: int
) -> None:
    losses = Losses()
    begins = [1000 * k for k in range(publishers, 0, -1)]
    assert [losses.before(begin) for begin in begins] == [0] * publishers
    assert losses.before(begins[0] + 2) == first

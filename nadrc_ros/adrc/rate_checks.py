"""What is refused of settings once the rate of their loop is known."""

from __future__ import annotations

from nadrc_ros.adrc.errors import SettingError

# Of a known frequency, w h, and of a known pole, -p h. With a sample lost they are still seen.
MOST_TURN, MOST_DECAY = 1.57, 2.0
# Periods. So many of a dead time are exact; a slower loop is as good for a longer one.
LONGEST_DELAY = 100
# Of times. A report that comes once in each has up to two behind it, as one is added to its age.
_FEWEST, _FEWEST_OF_REPORTS = 2.0, 3.0


def check_times(
    rate: float,
    *,
    measurement_timeout: float,
    max_dt: float,
    applied_timeout: float,
    feed_forward_timeout: float,
    input_delay: float,
) -> None:
    """
    Refuse times that are too short, or a delay that is too long, for a loop at ``rate`` [Hz].

    Raises
    ------
    SettingError
        For one below two periods, or an ``applied_timeout`` below three; of the first two both
        are named if need be. Also for an ``input_delay`` of more than a hundred periods.

    """
    if input_delay * rate > LONGEST_DELAY * (1.0 + 1e-9):
        raise SettingError(
            'input_delay',
            input_delay,
            f'at most {LONGEST_DELAY / rate:g} s, {LONGEST_DELAY} periods at {rate:g} Hz; it is '
            'in seconds, and a plant with a longer one needs no loop of that rate',
        )
    shortest = _FEWEST / rate
    allowed = f'at least two periods, {shortest:g} s at {rate:g} Hz'
    if 0.0 < feed_forward_timeout < shortest:
        raise SettingError('feed_forward_timeout', feed_forward_timeout, f'0 (off) or {allowed}')
    shortest_of_reports = _FEWEST_OF_REPORTS / rate
    if 0.0 < applied_timeout < shortest_of_reports:
        raise SettingError(
            'applied_timeout',
            applied_timeout,
            f'0 (off) or at least three periods, {shortest_of_reports:g} s at {rate:g} Hz: the '
            'newest report may be as old',
        )
    if 0.0 < measurement_timeout < shortest:
        if max_dt < shortest:
            allowed += f', and so must be max_dt = {max_dt!r}'
        raise SettingError('measurement_timeout', measurement_timeout, f'0 (off) or {allowed}')
    if max_dt < shortest:
        raise SettingError('max_dt', max_dt, allowed)


def check_known_rate(
    plant_poles: tuple[float, ...], frequencies: tuple[float, ...], rate: float
) -> None:
    """
    Refuse what a loop at ``rate`` [Hz] does not see.

    Raises
    ------
    SettingError
        For a frequency of less than four samples a cycle, or a pole that settles within a period.

    """
    if max(frequencies) > MOST_TURN * rate:
        raise SettingError(
            'disturbance_frequencies',
            frequencies,
            f'at most {MOST_TURN * rate:g} rad/s at {rate:g} Hz, four samples a cycle',
        )
    if min(plant_poles) < -MOST_DECAY * rate:
        raise SettingError(
            'plant_poles',
            plant_poles,
            f'at least {-MOST_DECAY * rate:g} rad/s at {rate:g} Hz: leave out a pole that '
            'settles within a period, and lower the order',
        )

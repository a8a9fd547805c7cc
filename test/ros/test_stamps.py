"""The time that a sample spans, from what the middleware says of it."""

from __future__ import annotations

from nadrc_ros.ros.stamps import Departures, Offset, SampleTimes
import pytest

MS = 1_000_000
PERIOD = 0.005
START = 1_700_000_000_000 * MS


class Line:
    """Samples on their way, from a clock that is ``behind`` [ms]; received a little later."""

    def __init__(self, stamped: bool = True, behind: float = 0.0, period: float = PERIOD) -> None:
        self.behind = behind
        self.wall = START
        options = {} if stamped else {'stamped': False}
        self.times = SampleTimes(period, wall=lambda: self.wall, **options)

    def span(
        self,
        number: int | None,
        sent: float,
        *,
        clock: float = 0.0,
        delay: float = 0.2,
        now: float | None = None,
    ) -> float:
        """Return what spans [ms]: sent, offset of both clocks, delay, own clock in ms."""
        stamp = START + round((sent + clock) * MS)
        info = {
            'source_timestamp': stamp,
            'received_timestamp': stamp + round((self.behind + delay) * MS),
            'publication_sequence_number': number,
        }
        own = sent + delay if now is None else now
        self.wall = START + round((own + clock + self.behind) * MS)
        return 1e3 * self.times.span(info, round(own * MS))


def test_the_first_sample_spans_a_period_and_the_next_what_the_source_says() -> None:
    line = Line()
    assert (line.times.late, line.times.spacing) == (0.0, 0.0)
    assert line.span(1, 0.0) == 5.0
    assert (line.times.late, line.times.spacing) == (0.0, 0.0)
    assert line.span(2, 5.0, delay=3.0) == pytest.approx(5.0)  # free of the jitter of transport
    assert line.span(3, 11.0, delay=0.1) == pytest.approx(6.0)
    assert line.span(6, 26.0) == pytest.approx(15.0)  # across lost ones
    assert line.times.spacing == pytest.approx(0.015)
    assert (line.times.from_future, line.times.clock_jumps) == (0, 0)


def test_p09_a_stamp_from_the_future_is_counted_and_the_receipt_used() -> None:
    line = Line()
    line.span(1, 0.0)
    assert line.span(2, 5.0, clock=3_600_000.0, delay=-3_600_000.0 + 0.2, now=5.2) == (
        pytest.approx(5.2)
    )
    assert line.times.from_future == 1
    assert line.span(3, 10.0) == pytest.approx(4.8)
    assert line.times.clock_jumps == 0


def test_p10_what_a_stall_made_late_is_no_clock_jump() -> None:
    """A process that stood still takes the oldest sample first, and newer ones right after."""
    line = Line()
    line.span(1, 0.0, delay=300.0)
    assert line.span(60, 300.0) == pytest.approx(300.0)
    assert line.span(61, 305.0, delay=100.0) == pytest.approx(5.0)
    assert line.span(80, 400.0, delay=6.0) == pytest.approx(95.0)
    assert line.span(81, 405.0, delay=1.6) == pytest.approx(5.0)
    late = 405.0 + 600_000.0  # after ten minutes of silence
    assert line.span(82, late, delay=300.0) == pytest.approx(600_000.0)
    assert line.span(142, late + 300.0) == pytest.approx(300.0)
    assert line.times.clock_jumps == 0
    assert line.span(143, late + 305.0, clock=200.0) == pytest.approx(5.0)
    assert line.times.clock_jumps == 1


def test_p07_a_sample_is_as_late_as_its_stamp_says() -> None:
    line = Line()
    late = []
    for number, (sent, delay) in enumerate(((0, 9), (5, 9), (10, 500), (510, 1), (515, 1)), 1):
        line.span(number, float(sent), delay=float(delay))
        late.append(round(1e3 * line.times.late, 6))
    assert late == [0.0, 0.0, 491.0, 0.0, 0.0]


def test_p10_a_stall_after_a_late_first_sample_is_no_clock_jump() -> None:
    line = Line()
    line.span(1, 0.0, delay=300.0)
    assert line.span(2, 1500.0) == pytest.approx(1500.0)
    assert line.times.clock_jumps == 0


@pytest.mark.parametrize(
    ('spacing', 'late', 'jumps'),
    [(5.0, 259, 0), (5.0, 261, 1), (100.0, 20, 0), (100.0, 21, 1)],
)
def test_p10_all_samples_may_be_late_for_a_second_and_for_twenty_of_them(
    spacing: float, late: int, jumps: int
) -> None:
    line = Line()
    for number in range(1, late + 1):
        line.span(number, spacing * number, delay=300.0)
    assert line.times.clock_jumps == 0
    line.span(late + 1, spacing * (late + 1))
    assert line.times.clock_jumps == jumps


@pytest.mark.parametrize(('delay', 'jumps'), [(480.0, 0), (520.0, 1)])
def test_p10_a_slow_loop_allows_for_five_of_its_periods(delay: float, jumps: int) -> None:
    line = Line(period=0.1)
    for number in range(1, 31):
        line.span(number, 100.0 * number, delay=delay)
    line.span(31, 3100.0)
    assert line.times.clock_jumps == jumps


def test_p09_a_sample_in_reserve_that_another_overtook_is_counted() -> None:
    times = SampleTimes(0.005, numbered=False)
    infos = [{'source_timestamp': t, 'publication_sequence_number': None} for t in (5, 9, 7)]
    assert times.saw(infos[0], infos[1]) and times.out_of_order == 0
    assert not times.saw(infos[1], infos[2]) and times.out_of_order == 1


@pytest.mark.parametrize(
    ('period', 'back', 'jumps'),
    [(0.005, 90.0, 0), (0.005, 110.0, 1), (0.1, 900.0, 0), (0.1, 1100.0, 1)],
)
def test_p10_without_numbers_a_clock_is_set_back_from_a_tenth_of_a_second_or_ten_periods(
    period: float, back: float, jumps: int
) -> None:
    """What is less far back is a sample that another overtook."""
    times = SampleTimes(period, wall=lambda: START, numbered=False)
    for sent, own in ((5000.0, 5000.0), (5000.0 - back, 5000.0 + 1e3 * period)):
        stamp = START + round(sent * MS)
        info = {
            'source_timestamp': stamp,
            'received_timestamp': START + round((own + 0.2) * MS),
            'publication_sequence_number': None,
        }
        times.span(info, round((own + 0.2) * MS))
    assert (times.clock_jumps, times.out_of_order) == (jumps, 1 - jumps)


def test_p10_a_jump_of_a_clock_that_was_behind_from_the_start_is_seen() -> None:
    line = Line(behind=400.0)
    for number in range(1, 301):
        line.span(number, 5.0 * number)
    line.behind = 0.0  # now it is set right
    assert line.span(301, 1505.0, clock=400.0) == pytest.approx(5.0)
    assert line.times.clock_jumps == 1
    assert line.span(302, 1510.0, clock=400.0) == pytest.approx(5.0)
    assert line.times.clock_jumps == 1


@pytest.mark.parametrize('drift', [-5e-5, 5e-5])
def test_p10_a_jump_of_another_machine_is_seen_whose_clock_drifts(drift: float) -> None:
    line = Line()
    for number in range(1, 5001):
        line.span(number, 1000.0 * number, clock=drift * 1000.0 * number)
        line.wall = START + 10_000_000 * MS  # that of this machine tells nothing
    later = 5_001_000.0
    assert line.times.clock_jumps == 0
    assert line.span(5001, later, clock=drift * later + 100.0) == pytest.approx(1000.0, abs=0.1)
    assert line.times.clock_jumps == 1
    later += 7_200_000.0  # hours of silence
    line.span(5002, later, clock=drift * later + 100.0)
    assert line.times.clock_jumps == 1


def test_p10_a_jump_back_on_a_late_sample_is_one_jump() -> None:
    line = Line()
    line.span(1, 0.0)
    assert line.span(2, 5.0, clock=-200.0, delay=300.0) == pytest.approx(304.8)
    assert line.span(3, 305.0, clock=-200.0) == pytest.approx(300.0)
    assert line.times.clock_jumps == 1


@pytest.mark.parametrize('number', [1, 3, None])
def test_p10_a_jump_forward_is_seen_whoever_numbers(number: int | None) -> None:
    """The publisher was restarted, or the middleware does not number."""
    line = Line()
    line.span(number and 1, 0.0)
    line.span(number and 2, 5.0)
    assert line.span(number, 55.0, clock=400.0) == pytest.approx(50.0)
    assert line.times.clock_jumps == 1


def test_p09_duplicates_and_reordered_samples_span_nothing_and_shift_nothing() -> None:
    line = Line()
    line.span(1, 0.0)
    line.span(3, 10.0)
    assert line.span(3, 10.0, now=12.0) <= 0.0
    assert line.span(2, 5.0, now=13.0) <= 0.0
    assert line.times.out_of_order == 2
    assert line.span(4, 15.0) == pytest.approx(5.0)
    assert (line.times.clock_jumps, line.times.out_of_order) == (0, 2)


def test_p09_a_late_duplicate_is_no_new_sample() -> None:
    line = Line()
    for number in range(1, 101):
        line.span(number, 5.0 * number)
    assert line.span(10, 50.0, now=501.0) <= 0.0
    assert line.span(101, 505.0) == pytest.approx(5.0)


@pytest.mark.parametrize('jump', [-3_600_000.0, -2.0, -5.0, 3_600_000.0, 200.0])
def test_p10_a_clock_jump_is_counted_and_the_receipts_used(jump: float) -> None:
    line = Line()
    line.span(1, 0.0)
    line.span(2, 5.0)
    expected = 5.0 if jump != -2.0 else 3.0  # too small to be told from jitter
    assert line.span(3, 10.0, clock=jump) == pytest.approx(expected)
    assert line.times.clock_jumps == (jump != -2.0)
    assert line.span(4, 15.0, clock=jump) == pytest.approx(5.0)
    assert line.times.clock_jumps == (jump != -2.0)


def test_a_restarted_publisher_is_followed() -> None:
    line = Line()
    for number in range(1, 101):
        line.span(number, 5.0 * number)
    assert line.span(1, 700.0) == pytest.approx(200.0)
    assert line.span(2, 705.0) == pytest.approx(5.0)


def test_a_publisher_restarted_behind_its_old_clock_is_followed_from_its_second_sample() -> None:
    line = Line()
    for number in range(1, 101):
        line.span(number, 5.0 * number)
    assert line.span(1, 700.0, clock=-10_000.0) <= 0.0
    assert line.span(2, 705.0, clock=-10_000.0) == pytest.approx(205.0)
    assert line.span(3, 710.0, clock=-10_000.0) == pytest.approx(5.0)
    assert line.times.clock_jumps == 1


def test_without_publication_numbers_a_clock_jump_does_not_poison() -> None:
    line = Line()
    line.span(None, 0.0)
    assert line.span(None, 5.0) == pytest.approx(5.0)
    assert line.span(None, 5.0, now=6.0) <= 0.0
    assert line.span(None, 10.0, clock=-10_000.0) == pytest.approx(5.0)
    assert line.span(None, 15.0, clock=-10_000.0) == pytest.approx(5.0)


def test_simulated_time_counts_receipts_and_a_step_back_costs_one_sample() -> None:
    line = Line(stamped=False)
    line.span(1, 0.0, now=1000.0)
    assert line.span(2, 1.0, now=1005.0) == pytest.approx(5.0)
    assert line.span(3, 2.0, now=1005.0) == 0.0  # the clock did not tick in between
    assert line.span(4, 3.0, now=1010.0) == pytest.approx(5.0)
    assert line.span(5, 4.0, now=10.0) == 0.0
    assert line.times.clock_jumps == 1
    assert line.span(6, 5.0, now=15.0) == pytest.approx(5.0)


def test_p09_a_restarted_publisher_that_is_twice_as_fast_as_the_controller_is_followed() -> None:
    line = Line()
    for number in range(2, 101, 2):
        line.times.saw({'publication_sequence_number': number - 1}, {})
        line.span(number, 2.5 * number)
    spans = []
    for number in range(2, 21, 2):  # numbers and clock begin anew
        line.times.saw({'publication_sequence_number': number - 1}, {})
        spans.append(line.span(number, 2.5 * number - 1e6, now=300.0 + 2.5 * number))
    assert spans[1:] == [pytest.approx(5.0)] * 9


class Way:
    """From a publisher to a recorder: the clock of stamps here, and how much that one is ahead."""

    def __init__(self) -> None:
        self.wall = START
        self.steady = 77 * MS
        self.ahead = 0.0
        self.number = 0
        self.departures = Departures(lambda: self.wall - self.steady)

    def take(self, sent: float, delay: float = 0.2, step: float = 0.0) -> float:
        """Return when a sample left [ms]; on its way our clock is stepped by so much."""
        self.number += 1
        stamp = self.wall - self.steady + 77 * MS + round((sent + self.ahead) * MS)
        now = 77 * MS + round((sent + delay) * MS)
        self.wall += now - self.steady + round(step * MS)
        self.steady = now
        info = {'source_timestamp': stamp, 'publication_sequence_number': self.number}
        return (self.departures.of(info, now) - 77 * MS) / MS


def test_a_sample_left_when_its_stamp_says_however_late_it_comes() -> None:
    way = Way()
    for k in range(100):
        assert way.take(5.0 * k, 0.2 + 30.0 * (k % 7 == 3)) == pytest.approx(5.0 * k)
    stalled = [way.take(500.0 + 5.0 * k, max(0.2, 400.0 - 5.0 * k)) for k in range(200)]
    assert stalled == pytest.approx([500.0 + 5.0 * k for k in range(200)])
    assert way.departures.clock_jumps == 0


@pytest.mark.parametrize('ahead', [-3_600_000.0, -500.0, 50.0, 3_600_000.0])
def test_a_sample_of_another_clock_left_when_the_quickest_one_came(ahead: float) -> None:
    way = Way()
    way.ahead = ahead
    times = [way.take(5.0 * k, 0.2 + 30.0 * (k % 7 == 3)) for k in range(600)]
    assert times == pytest.approx([5.0 * k + 0.2 for k in range(600)])


@pytest.mark.parametrize('drift', [-1e-4, 1e-4])
def test_a_clock_of_another_machine_is_followed_as_it_drifts(drift: float) -> None:
    way = Way()
    for k in range(2000):
        way.ahead = 3_600_000.0 + drift * 50.0 * k
        assert way.take(50.0 * k) == pytest.approx(50.0 * k, abs=0.5)
    assert way.departures.clock_jumps == 0


@pytest.mark.parametrize('step', [-3_600_000.0, -300.0, 300.0, 3_600_000.0])
def test_a_step_of_the_clock_moves_no_sample_but_one_on_its_way(step: float) -> None:
    """The clock of the machine is set: that of stamps here and that of the publisher."""
    way = Way()
    for k in range(100):
        way.take(5.0 * k)
    way.take(500.0, step=step)
    assert [way.take(5.0 * k) for k in range(101, 400)] == pytest.approx(
        [5.0 * k for k in range(101, 400)], abs=0.21
    )


@pytest.mark.parametrize('step', [-3_600_000.0, -300.0, 3_600_000.0])
def test_a_step_of_the_publishers_clock_moves_no_sample(step: float) -> None:
    way = Way()
    for k in range(100):
        way.take(5.0 * k)
    way.ahead = step
    assert [way.take(5.0 * k) for k in range(100, 400)] == pytest.approx(
        [5.0 * k for k in range(100, 400)], abs=0.21
    )
    assert way.departures.clock_jumps == 1


def test_samples_that_lay_there_when_the_first_one_is_taken_are_no_jumps_of_a_clock() -> None:
    """A recorder that starts on a busy machine said so of every sample of the first second."""
    for lain in (100, 1):
        way = Way()
        for k in range(lain):
            way.take(5.0 * k, 500.0 - 5.0 * k)
        # Nor is the clock another one, or this signal would be apart from the others for good.
        times = [way.take(5.0 * k, 1.0 + k % 3) for k in range(101, 400)]
        assert times == pytest.approx([5.0 * k for k in range(101, 400)])
        assert way.departures.clock_jumps == 0


def test_a_sample_without_a_stamp_left_when_it_came() -> None:
    info = {'source_timestamp': 0, 'publication_sequence_number': None}
    assert Departures(lambda: 0).of(info, 123) == 123


def test_no_sample_left_after_it_came() -> None:
    """Clocks of one machine are read one after the other, which may take a microsecond."""
    info = {'source_timestamp': 1_000_001_000, 'publication_sequence_number': 1}
    assert Departures(lambda: 0).of(info, 1_000_000_000) == 1_000_000_000


def test_a_middleware_may_begin_to_number() -> None:
    departures = Departures(lambda: 0)
    for number, stamp in ((None, 1_000_000_000), (1, 1_005_000_000), (2, 1_010_000_000)):
        info = {'source_timestamp': stamp, 'publication_sequence_number': number}
        assert departures.of(info, stamp + 1000) == stamp
    assert departures.clock_jumps == 0


def test_what_interrupts_the_reading_of_two_clocks_moves_nothing() -> None:
    """Or samples that left right after each other would change places."""
    steady, late, ahead = [0], [0], [START]

    def read() -> int:
        steady[0] += 100
        return steady[0]

    def wall() -> int:
        read()
        steady[0] += late[0]
        return steady[0] + ahead[0]

    late[0] = 5 * MS
    assert Offset(wall, read)() == pytest.approx(START, abs=6 * MS)
    late[0] = 0
    offset = Offset(wall, read)
    first = offset()
    for late[0] in (0, 30_000, 5 * MS, 0):
        assert offset() == first
    ahead[0] += 20 * MS  # now the clock is set
    late[0] = 5 * MS
    assert offset() == first
    late[0] = 0
    assert offset() == pytest.approx(first + 20 * MS, abs=1000)

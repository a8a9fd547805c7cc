"""What is refused of known poles and frequencies."""

from __future__ import annotations

from nadrc_ros.adrc.errors import SettingError

MAX_FREQUENCIES = 3  # with five orders and five extended states the poles are right to 1e-8


def check_known(
    plant_poles: tuple[float, ...],
    frequencies: tuple[float, ...],
    slowest: float,
    measurement_period: float,
) -> None:
    """
    Refuse what no observer can have a model of.

    Raises
    ------
    SettingError
        For more frequencies than there may be, equal ones or any below ``slowest``, or an angle
        without a pole of 0.

    """
    known = [w for w in frequencies if w > 0.0]
    if len(known) > MAX_FREQUENCIES or len(set(known)) < len(known):
        raise SettingError(
            'disturbance_frequencies', frequencies, f'at most {MAX_FREQUENCIES} that differ'
        )
    if any(w < slowest for w in known):
        raise SettingError(
            'disturbance_frequencies', frequencies, f'0 (none) or at least {slowest:g} rad/s each'
        )
    if measurement_period > 0.0 and all(plant_poles):
        raise SettingError(
            'plant_poles',
            plant_poles,
            'with one that is 0 for an angle: a turn further its plant does the same',
        )

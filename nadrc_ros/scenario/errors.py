"""What is wrong with a scenario and is not the value of one setting."""

from __future__ import annotations

from nadrc_ros.adrc.errors import UserError


class ScenarioError(UserError):
    """
    A scenario cannot be read, lacks a key, or brings a plant whose code fails.

    The message is one sentence for the user. A bad value is a ``SettingError`` instead.
    """

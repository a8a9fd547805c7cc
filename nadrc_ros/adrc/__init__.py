"""The law: settings, observers, differentiator, feedback, fault policy, controller."""

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode, Status

__all__ = ['Cause', 'Controller', 'ControllerSettings', 'Mode', 'SettingError', 'Status']

"""Plants, signals, noise, metrics and the closed loop: no ROS, no clock, no files."""

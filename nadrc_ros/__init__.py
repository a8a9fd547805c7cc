"""Active disturbance rejection control with nested extended state observers, for ROS 2."""

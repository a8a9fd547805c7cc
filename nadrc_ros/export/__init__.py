"""A controller as C for machines without ROS, with the bits of the Python one."""

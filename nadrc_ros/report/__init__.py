"""What a run looks like: pictures of any result, offline or from the ROS graph."""

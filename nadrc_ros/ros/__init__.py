"""What the nodes share of ROS 2: parameters, topics, stamps, pacing, lockstep, diagnostics."""

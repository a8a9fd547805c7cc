"""Thin rclpy adapters around the law, the plants and the metrics: one file per executable."""

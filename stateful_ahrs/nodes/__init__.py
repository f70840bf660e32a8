"""The ROS nodes: messages and parameters in, messages out. Every decision lies elsewhere."""

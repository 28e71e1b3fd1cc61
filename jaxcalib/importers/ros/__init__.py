"""What is in bags of ROS, and how it becomes a vehicle's own motion and the objects that it saw."""

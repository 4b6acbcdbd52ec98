"""Plan -> text for others to read: ROS 2 parameter files, JSON. Same plan, same bytes."""

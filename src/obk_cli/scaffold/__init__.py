"""Create a ROS 2 package that runs, from a short request: check, render, decide, write."""

"""Runs a plan on this machine: joins the supervisor with processes, ROS and the user's screen."""

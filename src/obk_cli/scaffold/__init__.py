"""From a few answers to a ROS 2 package that runs: questions, render, decide, write."""

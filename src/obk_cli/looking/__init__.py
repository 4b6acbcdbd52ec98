"""Looking into a running stack: topics, rates, parameters, services; asks ROS nothing itself."""

"""ROS 2 for the tool: environment, participant, graph, topics, parameters, services."""

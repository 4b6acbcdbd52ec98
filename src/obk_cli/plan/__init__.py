"""What a sound config comes to: nodes, parameters and topics, ready to be launched."""

"""The result of compiling a valid config: nodes, parameters and topics, ready to launch."""

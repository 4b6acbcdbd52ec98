"""Topics, nodes, parameters, services and lifecycle states of a running stack."""

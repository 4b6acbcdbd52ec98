"""Topics, nodes, parameters, services and life cycles of a running stack."""

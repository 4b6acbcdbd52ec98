"""A plan as text: parameters, launch file, diagrams, JSON. Equal plans give equal bytes."""

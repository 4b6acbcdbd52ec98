"""A plan as text: parameters, launch file, pictures, JSON. The same plan gives the same bytes."""

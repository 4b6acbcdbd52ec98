"""A plan as text: parameters, launch file, pictures, JSON. Equal plans give equal bytes."""

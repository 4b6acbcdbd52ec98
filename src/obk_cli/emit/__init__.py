"""Plan -> text for others: parameters, launch files, pictures, JSON. Same plan, same bytes."""

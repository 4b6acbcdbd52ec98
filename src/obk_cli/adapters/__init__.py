"""Foreign libraries and the surroundings, each behind one door."""

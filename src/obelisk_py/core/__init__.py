"""What every Obelisk node is made of: life cycle, components, and the five base classes."""

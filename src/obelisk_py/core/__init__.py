"""Life cycle, components and the five base classes of Obelisk nodes."""

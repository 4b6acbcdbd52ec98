"""The nodes of the arm; the control law is in a separate module."""

"""Messages to the bytes of the wire format (CDR), and back."""

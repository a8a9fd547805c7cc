"""A number inside any message: its address, where it is in the serialised bytes, reading it."""

"""Commissioning experiments: bounded motions of a machine of which little is known yet."""

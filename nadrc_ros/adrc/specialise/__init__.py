"""The law for one shape of design: evaluated as far as the shape tells."""

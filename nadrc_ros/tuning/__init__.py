"""Finding the numbers of a controller: a first design from requirements, and tuning."""

"""Finding the numbers of a controller: from requirements, from a log, by search."""

"""
Finding the numbers of a controller: from requirements, from a log, by search.

Here are the rules of thumb on which design, identification and search agree.
"""

# Observer bandwidth times period. Up to there the sampled observer does what its continuous design
# says; beyond, sampling eats the margins up.
LARGEST_W_H = 0.3
# Distance of the loop from -1: a maximum sensitivity of 2.5.
LEAST_MODULUS = 0.4
# Factor on the gain of the plant, either way, and periods of delay, that a loop bears.
LEAST_GAIN, LEAST_DELAY = 2.0, 1.0
# Factors on the known poles of the plant, and by what share a step may overshoot with them.
WRONG_POLES, LARGEST_OVERSHOOT = (0.5, 2.0), 0.06

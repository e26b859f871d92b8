"""What stands where in the two tables of an arena that are not about single beads."""

# columns of `numbers`
STEP, SKIN, GRAVITY, LOW, CELL, MOST_SPEED = 0, 1, 2, 5, 8, 9
NUMBERS = 10
# columns of `counts`
BEADS, LISTED, LIVE_LIST, PAIRS, WALL_COUNT, STATUS, CULPRIT = range(7)
NX, NY, NZ, OPEN, GONE, BUILDS, DONE = range(7, 14)
BODIES = 14
MIXED = 15  # 1: beads may differ in size, weight or law
COUNTS = 16
# values of STATUS
OK, PAIRS_FULL, NEAR_FULL, LEFT_DOMAIN, EXPLODED = range(5)

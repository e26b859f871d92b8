"""What stands where in the two tables of an arena that are not about single beads."""

# columns of `numbers`
STEP, SKIN, GRAVITY, LOW, CELL, MOST_SPEED = 0, 1, 2, 5, 8, 9
BEFORE = 10  # steps made before a burst
WORST = 11  # largest overlap of beads that have left
NUMBERS = 12
# columns of `counts`
BEADS, LISTED, LIVE_LIST, PAIRS, WALL_COUNT, STATUS, CULPRIT = range(7)
NX, NY, NZ, OPEN, GONE, BUILDS, DONE = range(7, 14)
BODIES = 14
MIXED = 15  # 1: beads may differ in size, weight or law
BURST_LENGTH, CHUNKS, STAGE = 16, 17, 18  # steps of a burst, parts of the list, and the step it is at
LATE = 19  # 1: a thread was kept waiting
KEPT, WHOLE = 20, 21  # beads in the next list; 1: it is not made in parts, which did not fit
COUNTS = 22
# values of STATUS
OK, PAIRS_FULL, NEAR_FULL, LEFT_DOMAIN, EXPLODED = range(5)

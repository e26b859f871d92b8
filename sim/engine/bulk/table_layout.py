"""Column numbers of the tables `numbers` and `counts` of an arena, and the values of STATUS."""

# columns of `numbers`
STEP, SKIN, GRAVITY, LOW, CELL, MOST_SPEED = 0, 1, 2, 5, 8, 9
BEFORE = 10  # number of steps before a burst
WORST = 11  # largest overlap of beads that have left
NUMBERS = 12
# columns of `counts`
BEADS, LISTED, LIVE_LIST, PAIRS, WALL_COUNT, STATUS, CULPRIT = range(7)
NX, NY, NZ, OPEN, GONE, BUILDS, DONE = range(7, 14)
BODIES = 14
MIXED = 15  # 1: beads may differ in size, mass or contact law
BURST_LENGTH, CHUNKS, STAGE = 16, 17, 18  # steps of a burst, parts of the list, present step of the burst
LATE = 19  # 1: a thread had to wait too long
KEPT, WHOLE = 20, 21  # beads in the next list; 1: the list is built by one thread, as parts did not fit
COUNTS = 22
# values of STATUS
OK, PAIRS_FULL, NEAR_FULL, LEFT_DOMAIN, EXPLODED = range(5)

"""Decks: input files with which another DEM code computes a twin, and the reading of what it wrote.

- card.py: parameters of particle, walls and contacts alone (EDEM, LIGGGHTS, CSV)
- scene.py: walls, motions and start positions of a rig, the same for all codes
- deck.py: `Deck`, its folder and its description in deck.json
- liggghts.py, lammps.py, yade.py: the input files of each code, and the contact law in its conventions
- read.py: text dumps to frames and to the record of the rig
"""

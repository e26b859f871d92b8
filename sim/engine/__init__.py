"""The DEM itself: state, neighbours, contacts, walls, time steps."""

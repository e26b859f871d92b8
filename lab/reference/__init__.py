"""Published materials, particles and contacts that a lab can use by name."""

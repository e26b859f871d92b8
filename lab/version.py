"""Version of rigtwin; results state it."""

__version__ = "0.2.0"
RELEASED = "2026-11-28"  # ISO 8601; CITATION.cff has both, too

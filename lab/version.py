"""Version of rigtwin; results state it."""

__version__ = "0.2.0.dev0"

"""The commands behind the door: their options, and how results are shown."""

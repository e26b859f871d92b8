"""Model and rig to records: the digital twins; never imports the measurement."""

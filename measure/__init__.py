"""Media to records to quantities; never imports the simulation."""

"""Twins, deviations and the report: the only room that sees both measurement and simulation."""

"""Diagnosis: locate where twin and measurement disagree, name the missing effect, add it, show the gap shrink."""

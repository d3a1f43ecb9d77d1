"""Evidence of a track for diagnoses, and their findings."""

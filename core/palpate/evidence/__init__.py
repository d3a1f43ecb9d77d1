"""What diagnoses are given of a track, and what they say of it."""

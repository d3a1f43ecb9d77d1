"""Many runs at once: on all cores, or on the workers of a cluster."""

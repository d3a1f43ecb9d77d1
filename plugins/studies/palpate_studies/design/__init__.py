"""Design: how well a palpation can tell its parameters at best, before anything moves."""

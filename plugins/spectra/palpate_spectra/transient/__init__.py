"""The material's answer in time: relaxation at a held depth, creep at a held force, and the spectrum of times."""

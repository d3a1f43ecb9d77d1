"""Software twins: robots and sensors that speak the wire protocol of the real ones."""

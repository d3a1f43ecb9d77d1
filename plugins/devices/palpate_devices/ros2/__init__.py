"""Topics of a ROS 2 system as a device, by DDS and without a ROS installation: read, and never commanded."""

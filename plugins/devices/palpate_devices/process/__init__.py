"""A piece of a device in a process of its own: shared memory, heartbeats and a socket."""

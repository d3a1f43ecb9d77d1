"""Members of a ROS 2 system, by the middleware that the system uses."""

from __future__ import annotations

from palpate_ros2.network import Network, Participant, Talker


def participant(network: Network) -> Participant:
    """Return a member that listens; raises DeviceError where the middleware does not come up."""
    if network.middleware == "zenoh":
        from palpate_ros2.zenoh_participant import ZenohParticipant

        return ZenohParticipant(network)
    from palpate_ros2.cyclone import CycloneParticipant

    return CycloneParticipant(network)


def talker(network: Network) -> Talker:
    """Return a member that publishes; raises DeviceError where the middleware does not come up."""
    if network.middleware == "zenoh":
        from palpate_ros2.zenoh_participant import ZenohTalker

        return ZenohTalker(network)
    from palpate_ros2.cyclone import CycloneTalker

    return CycloneTalker(network)

"""The contract everyone shares: messages, keys, the intersection map, the codec, the rules of motion."""

from gameopt_wire.messages import WIRE_VERSION

__all__ = ["WIRE_VERSION"]

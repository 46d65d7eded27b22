"""How both sides set Zenoh up unless a configuration file of the user's says otherwise."""

from __future__ import annotations

TX_BATCHES = 8
"""Batches of 64 kB that may wait for one reader; Zenoh takes memory for those that do.

Under the wall clock what does not fit is dropped after a millisecond. A control cycle's commands are 300 bytes
each with their keys, so 200 of them fill a batch. Of Zenoh's own two batches one is being written while the next
fills: its thread had only to lose the core for some milliseconds, and commands were lost. Eight hold the states
or commands of 1,000 vehicles.
"""

SETTINGS = {
    # Who connects to whom is said; with gossip on, peers would talk past the hub's access control.
    "scouting/multicast/enabled": "false",
    "scouting/gossip/enabled": "false",
    "transport/link/tx/queue/size/data": str(TX_BATCHES),
}
"""Zenoh's configuration keys and their values in JSON5."""

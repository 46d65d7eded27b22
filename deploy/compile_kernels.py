"""Compile the kernels ahead of the first start, by driving both profiles once, as `gameopt-im serve` does.

For images. The kernels go to NUMBA_CACHE_DIR; where that is read at run time, nothing is compiled any more.
"""

from __future__ import annotations

import asyncio

from gameopt_im.core.parameters import Parameters
from gameopt_im.options import ServeOptions
from gameopt_im.warm_up import warm_up
from gameopt_sumo.network import packaged_map
from gameopt_wire.messages import Geometry, Profile

PROFILES: tuple[tuple[Profile, Geometry], ...] = (("default", "areas"), ("paper", "box"))


async def main() -> None:
    """One rehearsal for each profile, on the packaged map."""
    for profile, geometry in PROFILES:
        options = ServeOptions(map=packaged_map(), parameters=Parameters(), profile=profile, geometry=geometry)
        await warm_up(options)


if __name__ == "__main__":
    asyncio.run(main())

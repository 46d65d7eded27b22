"""SUMO, the road: nets, scenarios, the running simulation, and the independent count of collisions."""

"""The baselines: what SUMO's own controls make of the same arrivals, measured by the same meter."""

"""Pure functions of a snapshot: no clock, no files, no network, no solver."""

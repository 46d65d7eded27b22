"""Independent bidders: `gameopt-vehicles`. Nothing here imports the manager."""

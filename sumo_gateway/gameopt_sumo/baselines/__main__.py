"""`python -m gameopt_sumo.baselines`."""

from gameopt_sumo.baselines.cli import main

main()

"""The solvers of the programs, and the worker processes they live in."""

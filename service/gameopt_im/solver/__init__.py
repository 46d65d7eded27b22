"""OSQP workspaces and the worker processes they live in."""

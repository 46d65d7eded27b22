"""The manager's web server: metrics and health. Reads what the manager knows, decides nothing."""

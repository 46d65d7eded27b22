"""The manager's web server: live page, metrics and health. Reads what the manager knows, decides nothing."""

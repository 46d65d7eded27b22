"""One method against another on the same arrivals: runs, figures over seeds, plots and a page to read."""

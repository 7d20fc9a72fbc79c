"""What a simulation will do, decided before it runs, as plain picklable data."""

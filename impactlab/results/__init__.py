"""Results: labelled datasets and their files."""

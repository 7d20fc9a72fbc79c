"""Coverage of the intervals of records and of questions: random networks of all classes."""

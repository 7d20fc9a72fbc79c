"""The trust study: random networks of all classes at default settings."""

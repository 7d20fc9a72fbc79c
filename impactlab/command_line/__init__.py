"""The command line: each family of commands has a module of its own."""

"""Impulses at random times: the motion under them, the moments of those in a sample, and their part of a plan."""

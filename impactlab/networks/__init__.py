"""Networks: built, checked, compiled as a right-hand side."""

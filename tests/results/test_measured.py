"""Values with their errors as text."""

import pytest

from impactlab.results.measured import measured_text


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.04966, 0.0001, "0.0497 ± 0.0001"),
        (0.04966, 0.00014, "0.04966 ± 0.00014"),  # 0.0001 would be a third less
        (0.123456, 0.00123, "0.1235 ± 0.0012"),
        (12345.6, 78.9, "12350 ± 80"),
        (0.9996, 0.00096, "1.000 ± 0.001"),
        (-3.21e-7, 1.5e-8, "(-3.21 ± 0.15)e-7"),
        (4.56e9, 2e7, "(4.56 ± 0.02)e9"),
        (0.0, 0.5, "0.0 ± 0.5"),
        (5.0, 30.0, "0 ± 30"),
        (2.5, 0.0, "2.5"),
        (2.5, float("nan"), "2.5"),
    ],
)
def test_digits_that_mean_something(value, error, text):
    assert measured_text(value, error) == text

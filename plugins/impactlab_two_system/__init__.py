"""The study of Luo, Yan and Zhang (2023): two oscillators that collide, and what the paper says of them."""

from impactlab_two_system.study import TwoSystemStudy

__all__ = ["TwoSystemStudy"]

"""Quantiles of the normal distribution."""

from scipy.stats import norm

HALF_WIDTH_90 = float(norm.ppf(0.95))  # of a 90 % interval, in standard deviations

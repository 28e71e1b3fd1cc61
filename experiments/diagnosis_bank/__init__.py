"""A bank of diagnosed cases, whose runs are kept: judged anew in seconds when rules of inference change."""

"""Times as SUMO writes them."""

SECONDS_PER_PART = (1.0, 60.0, 3600.0, 86400.0)  # from the last part of d:h:m:s


def read_time_s(text: str | None) -> float | None:
    """Seconds of a time in seconds or as h:m:s or d:h:m:s; None where it is neither."""
    parts = (text or "").strip().split(":")
    if len(parts) not in (1, 3, 4):
        return None
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        return None
    sign = -1.0 if parts[0].startswith("-") else 1.0
    return sign * sum(abs(n) * unit for n, unit in zip(reversed(numbers), SECONDS_PER_PART, strict=False))

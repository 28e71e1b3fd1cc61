"""Placeholder until the figures are there."""


def report_html(findings, diagnosis) -> str:
    """Return the report."""
    return f"<html><body><pre>{diagnosis.to_json()}</pre></body></html>"

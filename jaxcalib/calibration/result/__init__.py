"""What a calibration leaves in RUN: result.json, report.html and the calibrated scenario."""

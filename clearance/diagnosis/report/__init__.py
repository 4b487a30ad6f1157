"""The page a person reads: one HTML file that draws a diagnosis and its evidence, with no network."""

from clearance.diagnosis.report.page import render_report, write_report

__all__ = ["render_report", "write_report"]

"""The page a person reads: one HTML file that draws a diagnosis and its evidence, with no network."""

from clearance.diagnosis.report.page import plain, render_report, write_report

__all__ = ["plain", "render_report", "write_report"]

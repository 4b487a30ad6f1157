"""What a person looks at: one HTML file that draws a diagnosis and its evidence, and TensorBoard's events."""

from clearance.diagnosis.report.events import write_events
from clearance.diagnosis.report.page import plain, render_report, write_report

__all__ = ["plain", "render_report", "write_events", "write_report"]

"""A plan for people: the picture of motion and flight, and the report as one HTML file."""

from api.report.page import report_html
from api.report.picture import plan_svg

__all__ = ["plan_svg", "report_html"]

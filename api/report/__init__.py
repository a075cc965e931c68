"""A plan for people: the picture of motion and flight, the report as one HTML file; the picture of landings."""

from api.report.landings import landings_svg
from api.report.page import ReportContent, report_html
from api.report.picture import plan_svg

__all__ = ["ReportContent", "landings_svg", "plan_svg", "report_html"]

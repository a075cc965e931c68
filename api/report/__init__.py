"""A plan for people: the picture of motion and flight, the report as one HTML file; pictures of landings."""

from api.report.lags import lags_svg
from api.report.landings import explained_svg, landings_svg
from api.report.page import ReportContent, report_html

__all__ = ["ReportContent", "explained_svg", "lags_svg", "landings_svg", "report_html"]

"""What is planned by the thousand: throwability maps."""

from store.many.maps import LandingCellRow, MapPlan, MapRepository, MapRow

__all__ = ["LandingCellRow", "MapPlan", "MapRepository", "MapRow"]

"""What is planned by the thousand: batches and throwability maps."""

from store.many.batches import BatchDriven, BatchLost, BatchRepository, UnknownBatch
from store.many.maps import LandingCellRow, MapPlan, MapRepository, MapRow

__all__ = [
    "BatchDriven",
    "BatchLost",
    "BatchRepository",
    "LandingCellRow",
    "MapPlan",
    "MapRepository",
    "MapRow",
    "UnknownBatch",
]

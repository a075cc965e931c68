"""What is planned by the thousand: batches and throwability maps."""

from store.many.batches import BatchDriven, BatchLost, BatchRepository
from store.many.maps import MapRepository

__all__ = [
    "BatchDriven",
    "BatchLost",
    "BatchRepository",
    "MapRepository",
]

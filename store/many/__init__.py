"""What a driver works through: batches, throwability maps, and jobs of picks and throws."""

from store.many.batches import BatchDriven, BatchLost, BatchRepository
from store.many.jobs import JobDriven, JobLost, JobRepository
from store.many.maps import MapRepository

__all__ = [
    "BatchDriven",
    "BatchLost",
    "BatchRepository",
    "JobDriven",
    "JobLost",
    "JobRepository",
    "MapRepository",
]

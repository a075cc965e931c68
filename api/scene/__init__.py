"""What a picture of a cell and a plan needs, as JSON documents: the model of the cell, the curves of the plan."""

from api.scene.cell_model import cell_model
from api.scene.plan_curves import plan_curves

__all__ = ["cell_model", "plan_curves"]

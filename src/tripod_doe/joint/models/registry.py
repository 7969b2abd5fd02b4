"""The four models of the joint by name, the cheapest first."""

from tripod_doe.joint.models.balances import EQUILIBRIUM, KINETOSTATIC
from tripod_doe.joint.models.model import Model
from tripod_doe.joint.models.multibody_models import NEEDLES, ROLLERS

MODELS: dict[str, Model] = {model.name: model for model in (EQUILIBRIUM, KINETOSTATIC, ROLLERS, NEEDLES)}
"""All models of the joint by name."""

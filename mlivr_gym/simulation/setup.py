"""The setup of simulations: limits, controller, physics and disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from mlivr_gym.arguments import SEED, InstanceOf, checked
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.arguments import ARGUMENTS
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath, Struct
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.inverse_dynamics import robot_model
from mlivr_gym.simulation.parameters import ControllerParameters, Limits, Physics
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap


@dataclass(frozen=True)
class Setup:
    """Everything except the plan that determines how a plan is executed in simulation.

    Examples
    --------
    >>> setup = Setup.of("gentle", "feedforward", disturbances="all")
    >>> setup.timing.grasp_force, setup.controller.guidance, setup.disturbances.payload
    (25.0, 0.0, 5.0)
    """

    timing: Annotated[Limits | Durations, InstanceOf(Limits, Durations)] = field(
        default_factory=Limits
    )
    """`Limits` for a time-optimal execution, or fixed `Durations`."""
    controller: Annotated[ControllerParameters, InstanceOf(ControllerParameters)] = field(
        default_factory=ControllerParameters
    )
    """Parameters of the joint controller."""
    physics: Annotated[Physics, InstanceOf(Physics)] = field(default_factory=Physics)
    """Parameters of grasps and failures."""
    disturbances: Annotated[DisturbanceRanges, InstanceOf(DisturbanceRanges)] = field(
        default_factory=DisturbanceRanges
    )
    """Ranges of the disturbances."""

    def __post_init__(self) -> None:
        """Check the type of each part."""
        SETUP.check(self, FieldPath("", SettingError))

    @classmethod
    def of(
        cls,
        limits: Limits | dict[str, Any] | str | None = None,
        controller: ControllerParameters | dict[str, Any] | str | None = None,
        physics: Physics | dict[str, Any] | str | None = None,
        disturbances: DisturbanceRanges | dict[str, Any] | str | None = None,
    ) -> Setup:
        """Return a setup from instances, plain data or names; None stands for the defaults.

        A part is given as an instance, by its fields, or by a name: in `PACES`,
        `CONTROLLERS` and `PHYSICS` of `parameters`, or `disturbances.DISTURBANCES`. Raises a
        `SettingError` if a part is invalid; the message names it.
        """
        return cls(
            Limits.of(limits),
            ControllerParameters.of(controller),
            Physics.of(physics),
            DisturbanceRanges.of(disturbances),
        )

    @checked({**ARGUMENTS, "seed": SEED})
    def simulation(
        self, grasp_map: GraspMap, robot: RobotSpec, obstacles: Sequence[Box] = (), seed: int = 0
    ) -> Simulation:
        """Return a simulation with a disturbance that is drawn from a seed.

        Obstacles are boxes in addition to those of the map. Raises a `RobotError` if the robot's
        masses are not known, see `RobotSpec.dynamics_of`.
        """
        parts = robot_model(robot).nbody - 1
        drawn = self.disturbances.draw(seed, parts, robot.limbs, len(grasp_map))
        return Simulation(grasp_map, robot, self.physics, obstacles, self.controller, drawn)


SETUP = Struct.of(Setup)
"""Schema of the fields of a `Setup`."""

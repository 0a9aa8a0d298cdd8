"""How plans are carried out: pace, controller, figures of grasps and failures, disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from mlivr_gym.arguments import SEED, Of, checked
from mlivr_gym.errors import SettingError
from mlivr_gym.motion.arguments import WALK
from mlivr_gym.motion.clocks import Durations
from mlivr_gym.robot.specification import RobotSpec
from mlivr_gym.schema import FieldPath, Struct
from mlivr_gym.simulation.controller import Controller
from mlivr_gym.simulation.disturbances import Disturbances
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.inverse_dynamics import robot_model
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.world.boxes import Box
from mlivr_gym.world.grasp_map import GraspMap


@dataclass(frozen=True)
class Setup:
    """How plans are carried out.

    Attributes
    ----------
    timing
        How fast: as `Limits` allow, or in given `Durations`.
    controller
        The controller of the joints.
    physics
        Figures of grasps and failures.
    disturbances
        How far robot and module may be from what the controller knows.
    """

    timing: Limits | Durations = field(default_factory=Limits)
    controller: Controller = field(default_factory=Controller)
    physics: Physics = field(default_factory=Physics)
    disturbances: Disturbances = field(default_factory=Disturbances)

    def __post_init__(self) -> None:
        """Check that each part is one."""
        SETUP.check(self, FieldPath("", SettingError))

    @classmethod
    def of(
        cls,
        limits: Limits | dict[str, Any] | str | None = None,
        controller: Controller | dict[str, Any] | str | None = None,
        physics: Physics | dict[str, Any] | None = None,
        disturbances: Disturbances | dict[str, Any] | str | None = None,
    ) -> Setup:
        """A setup of parts as they are, as plain data, by name, or by default.

        Raises
        ------
        SettingError
            If a part is faulty; the message names it.
        """
        return cls(
            Limits.of(limits),
            Controller.of(controller),
            Physics.of(physics),
            Disturbances.of(disturbances),
        )

    @checked({**WALK, "seed": SEED})
    def simulation(
        self, grasp_map: GraspMap, robot: RobotSpec, obstacles: Sequence[Box] = (), seed: int = 0
    ) -> Simulation:
        """A simulation with a disturbance drawn from a seed.

        Raises
        ------
        RobotError
            If the robot's masses are not known, see `RobotSpec.limb_dynamics`.
        """
        parts = robot_model(robot).nbody - 1
        drawn = self.disturbances.draw(seed, parts, robot.limbs, len(grasp_map))
        return Simulation(grasp_map, robot, self.physics, obstacles, self.controller, drawn)

    def to_dict(self) -> dict[str, Any]:
        """The setup as plain data for JSON."""
        return {
            "timing": {"kind": type(self.timing).__name__} | asdict(self.timing),
            "controller": asdict(self.controller),
            "physics": asdict(self.physics),
            "disturbances": asdict(self.disturbances),
        }


SETUP = Struct(
    Setup,
    {
        "timing": Of(Limits, Durations),
        "controller": Of(Controller),
        "physics": Of(Physics),
        "disturbances": Of(Disturbances),
    },
)
"""Fields of a `Setup`."""

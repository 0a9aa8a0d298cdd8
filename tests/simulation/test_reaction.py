"""The reaction of a step against the forces of MuJoCo's grasps, and against Pinocchio."""

import json

import numpy as np
import pinocchio
import pytest

from mlivr_gym.errors import PlanError
from mlivr_gym.fastest import step_reactions, with_least_reaction
from mlivr_gym.motion.commitment import commitments
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.regrasp import RegraspPath, planned_regrasp
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.reaction import reaction_of
from mlivr_gym.simulation.station_load import station_load
from mlivr_gym.simulation.timing import step_trajectory, timed_path
from mlivr_gym.transitions.edge import Edge


@pytest.fixture(scope="module")
def chosen(checked_graph, walk):
    return with_least_reaction(checked_graph, walk)


def test_the_grasps_of_the_simulation_feel_the_planned_reaction(checked_graph, chosen):
    execution = execute(checked_graph, chosen)
    assert execution.failure is None
    load = station_load(execution.recording)
    sizes = np.linalg.norm(load.forces, axis=1)
    for k, reaction in enumerate(step_reactions(checked_graph, chosen)):
        during = execution.recording.step == k
        felt = np.trapezoid(sizes[during], load.times[during])
        assert reaction.impulse == pytest.approx(felt, rel=0.03)
        assert reaction.peak_force == pytest.approx(load.peak_forces[k], rel=0.1)


def test_the_peak_is_that_of_pinocchios_momentum(checked_graph, walk, tmp_path):
    """Its centroidal momentum along the sampled trajectory, differentiated numerically."""
    file = tmp_path / "robot.urdf"
    checked_graph.robot.to_urdf(file)
    model = pinocchio.buildModelFromUrdf(str(file), pinocchio.JointModelFreeFlyer())
    data = model.createData()
    way = step_trajectory(checked_graph, walk, 0, Limits())
    momenta = []
    for k in range(len(way.times)):
        w, x, y, z = way.base_quaternions[k]
        joints, rates = way.joint_positions[k].ravel(), way.joint_velocities[k].ravel()
        turn = pinocchio.Quaternion(w, x, y, z).toRotationMatrix()
        linear = turn.T @ way.base_velocities[k, :3]  # Pinocchio's are in the body frame
        q = np.array([*way.base_positions[k], x, y, z, w, *joints])
        v = np.array([*linear, *way.base_velocities[k, 3:], *rates])
        momenta.append(pinocchio.computeCentroidalMomentum(model, data, q, v).linear.copy())
    forces = np.linalg.norm(np.gradient(momenta, way.period, axis=0), axis=1)
    reaction = step_reactions(checked_graph, walk)[0]
    assert reaction.peak_force == pytest.approx(forces.max(), rel=0.02)
    assert reaction.impulse == pytest.approx(np.trapezoid(forces, way.times), rel=0.01)


def test_no_other_clear_swing_has_less_reaction(checked_graph, walk, chosen):
    before, after = (step_reactions(checked_graph, plan) for plan in (walk, chosen))
    assert sum(one.impulse for one in after) < sum(one.impulse for one in before)
    assert chosen.stances == walk.stances
    for k in range(len(walk.steps)):
        regrasp = planned_regrasp(checked_graph, walk, k)
        for other in commitments(checked_graph, regrasp, Edge(regrasp.path_kind, -1, -1, {})):
            reaction = reaction_of(timed_path(RegraspPath(checked_graph, other.regrasp)))
            assert after[k].impulse <= reaction.impulse + 1e-9


def test_a_file_keeps_the_chosen_swings_and_no_others(checked_graph, jem, chosen):
    data = json.loads(json.dumps(chosen.to_dict()))
    assert Plan.from_dict(data, jem).motion.steps == chosen.motion.steps
    data["motion"]["steps"][0]["knots"][1][1] += 1e-3
    with pytest.raises(PlanError, match=r"motion\.steps\[0\]"):
        Plan.from_dict(data, jem)

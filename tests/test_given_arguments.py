"""Whatever is given for an argument of a public function, it is taken, or refused in one line.

Each argument of each function below gets values of every type. What is not refused by the package's
own error, with the argument's name, has to work. The names of the arguments are those of the
signatures, so that a new one is tested too.
"""

import inspect
import json
from contextlib import suppress
from functools import cache, partial

import gymnasium
import numpy as np
import pytest
from fuzz import answer, given_values
from plans import first_steps

from mlivr_gym import GraspMap, Settings, State, jem_map, robot_spec, stance_graph
from mlivr_gym.closed_loop.belief import Belief
from mlivr_gym.closed_loop.crew import CrewMember
from mlivr_gym.closed_loop.depth_camera import DepthCamera
from mlivr_gym.closed_loop.ros_messages import point_cloud_message, points_of_message
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.envs.vector_env import MlivrVectorEnv
from mlivr_gym.envs.wrappers import ActionMaskObservation, RecordVideo
from mlivr_gym.errors import MlivrError, shortened
from mlivr_gym.fastest import ranked_plans, step_reactions, with_least_reaction
from mlivr_gym.files import write_whole
from mlivr_gym.motion.plan import Plan
from mlivr_gym.motion.time_scaling import Durations
from mlivr_gym.motion.trajectory_files import save_csv, save_npz, save_ros
from mlivr_gym.pictures.camera import Camera
from mlivr_gym.pictures.film import film
from mlivr_gym.pictures.map_views import MapViews
from mlivr_gym.pictures.plan_figure import plan_figure
from mlivr_gym.pictures.rendering import SceneRenderer
from mlivr_gym.pictures.route import Route
from mlivr_gym.planners import Planner
from mlivr_gym.planners.costs import Cost
from mlivr_gym.robot.cargo import Cargo
from mlivr_gym.simulation.controller import ControllerParameters
from mlivr_gym.simulation.disturbances import DisturbanceRanges
from mlivr_gym.simulation.dynamics import Physics
from mlivr_gym.simulation.execution import execute
from mlivr_gym.simulation.export import exported_model
from mlivr_gym.simulation.limits import Limits
from mlivr_gym.simulation.monte_carlo import execute_many
from mlivr_gym.simulation.setup import Setup
from mlivr_gym.simulation.simulator import Simulation
from mlivr_gym.simulation.timing import plan_trajectory, step_trajectory

ALSO = {
    "start": ("stance", "graspable point", "points"),
    "settings": ("settings",),
    "position": ("base position",),
    "quaternion": ("base quaternion",),
    "joints": ("joint angles",),
    "ghosts": ("base position", "base quaternion", "joint angles", "configuration"),
    "configuration": ("base position", "base quaternion", "joint angles"),
    "points": ("graspable point",),
    "grasp_map": ("map",),
    "limb_threshold": ("w_m",),
    "base_threshold": ("w_b",),
    "index": ("no step",),
    "keep": ("graspable point",),
    "point": ("graspable point",),
    "now": ("present time",),
    "present": ("base position", "base quaternion", "joint angles", "configuration"),
    "path": ("cannot write", "cannot read"),
}
"""What messages call some arguments besides their names."""


@pytest.fixture(scope="module", autouse=True)
def own_folder(tmp_path_factory):
    """Tables and files of these tests go to folders of their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, str(tmp_path_factory.mktemp("cache")))
        # What is drawn is not looked at here.
        drawn = "mlivr_gym.pictures.plan_figure"
        for name in ("solids", "base_path"):
            patch.setattr(f"{drawn}.MapViews.{name}", lambda *_, **__: None)
        patch.setattr(f"{drawn}.save_figure", lambda figure, path: write_whole(path, b""))
        patch.setattr(f"{drawn}.MapViews", cache(MapViews))
        picture = np.zeros((16, 32, 3), np.uint8)
        patch.setattr("mlivr_gym.pictures.film.film_pictures", lambda *_, **__: [picture])
        yield patch


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def things(small_map, own_folder, tmp_path_factory):
    """What the functions are called with where they are called right."""
    few, made = small_map.subset(np.arange(len(small_map)) % 3 == 0, "few"), {}

    def graph_once(*given):
        key = given[0].fingerprint, *given[1:]
        made[key] = made.get(key) or stance_graph(*given)
        return made[key]

    own_folder.setattr("mlivr_gym.envs.env.stance_graph", graph_once)
    graph = stance_graph(few, settings=Settings(collisions=False))
    env = MlivrEnv(map=few, collisions=False, render_mode="rgb_array")
    env.reset(seed=0)
    planner = Planner(graph)
    plan = planner.plan(graph.ids(env.state.stance), env.goal).unwrap()
    folder = tmp_path_factory.mktemp("files")
    plan.save(folder / "plan.json")
    plan = first_steps(plan, 1)
    (folder / "map.json").write_text(json.dumps(few.to_dict()))
    trajectory = plan_trajectory(graph, plan, period=0.1)
    return {
        "folder": folder, "map": few, "graph": graph, "env": env, "planner": planner, "plan": plan,
        "start": graph.ids(env.state.stance), "goal": env.goal.tolist(),
        "copies": MlivrVectorEnv(2, env=MlivrEnv(map=few, collisions=False, precompute=True)),
        "trajectory": trajectory, "recording": execute(graph, plan).recording,
        "route": Route.of(few, plan),
    }  # fmt: skip


def query(of):
    return {"start": of["start"], "goal": of["goal"]}


def walk(of):
    return {"graph": of["graph"], "plan": of["plan"]}


def scene(of):
    return {"grasp_map": of["map"], "robot": of["graph"].robot}


def small_scene(of):
    """With a robot of which no meshes ship, which would take long to compile."""
    robot = robot_spec("mlivr2-ur10e")
    return {"grasp_map": of["map"], "robot": robot, "width": 32, "height": 16}


def standing(of):
    return dict(zip(("position", "quaternion", "joints"), of["plan"].configuration(0), strict=True))


def settings(of):
    return {"settings": of["graph"].settings}


def held(of):
    return {"configuration": of["plan"].configuration(0), "points": of["plan"].stances[0]}


def drawn(of):
    return {"grasp_map": of["map"], "plan": of["plan"]}


FILM = {"path": "walk.gif", "size": (32, 16), "speed": 1000.0}


def believing(of, noise=0.003):
    return Belief(of["graph"], noise)


def seen(of):
    simulation, rng = Setup().simulation(of["map"], of["graph"].robot), np.random.default_rng(0)
    return {
        "model": simulation.model,
        "data": simulation.data,
        "robot": of["graph"].robot,
        "rng": rng,
    }


def moving(of):
    return {"trajectory": of["trajectory"], "present": of["plan"].configuration(0)}


def saved(save):
    return lambda of: (save, {"trajectory": of["trajectory"], "path": "walk"})


FUNCTIONS = {
    "MlivrEnv": lambda of: (MlivrEnv, {"map": of["map"], "collisions": False}),
    "MlivrEnv.reset": lambda of: (of["env"].reset, {}),
    "MlivrEnv.step": lambda of: (of["env"].step, {"action": 0}),
    "MlivrVectorEnv": lambda of: (MlivrVectorEnv, {"num_envs": 2, "env": of["env"]}),
    "MlivrVectorEnv.reset": lambda of: (of["copies"].reset, {}),
    "MlivrVectorEnv.step": lambda of: (of["copies"].step, {"actions": [0, 0]}),
    "ActionMaskObservation": lambda of: (ActionMaskObservation, {"env": of["env"]}),
    "RecordVideo": lambda of: (RecordVideo, {"env": of["env"], "video_folder": "films"}),
    "stance_graph": lambda of: (stance_graph, {"grasp_map": of["map"], **settings(of)}),
    "Planner": lambda of: (Planner, {"graph": of["graph"]}),
    "Planner.plan": lambda of: (of["planner"].plan, query(of)),
    "Planner.why_not": lambda of: (of["planner"].why_not, query(of)),
    "Planner.prepare": lambda of: (of["planner"].prepare, {"goal": of["goal"]}),
    "Planner.cost_to_go": lambda of: (of["planner"].cost_to_go, {"goal": of["goal"]}),
    "Planner.refined": lambda of: (of["planner"].refined, {"plan": of["plan"]}),
    "ranked_plans": lambda of: (ranked_plans, {"planner": of["planner"], **query(of)}),
    "step_reactions": lambda of: (step_reactions, walk(of)),
    "with_least_reaction": lambda of: (with_least_reaction, walk(of)),
    "Cost.named": lambda of: (Cost.named, {"cost": "base"}),
    "execute": lambda of: (execute, walk(of)),
    "execute_many": lambda of: (execute_many, {"graph": of["graph"], "plans": [], "workers": 1}),
    "step_trajectory": lambda of: (step_trajectory, {**walk(of), "index": 0}),
    "plan_trajectory": lambda of: (plan_trajectory, walk(of)),
    "Setup": lambda of: (Setup, {}),
    "Setup.of": lambda of: (Setup.of, {}),
    "Setup.simulation": lambda of: (Setup().simulation, scene(of)),
    "Simulation": lambda of: (Simulation, scene(of)),
    "DepthCamera": lambda of: (DepthCamera, {}),
    "DepthCamera.rays": lambda of: (DepthCamera(pixels=3).rays, {}),
    "DepthCamera.measure": lambda of: (DepthCamera(pixels=3).measure, seen(of)),
    "CrewMember": lambda of: (CrewMember, {"start": (0.0, 0.0, 0.0), "end": (1.0, 0.0, 0.0)}),
    "Belief.add_hits": lambda of: (
        believing(of).add_hits,
        {"hits": [], "present": held(of)["configuration"]},
    ),
    "Belief.update_graph": lambda of: (believing(of).update_graph, {"state": of["env"].state}),
    "Belief.is_blocked": lambda of: (
        believing(of).is_blocked,
        {"trajectory": of["trajectory"], "first": 0},
    ),
    "Belief.will_touch": lambda of: (believing(of).will_touch, moving(of) | {"sample": 0}),
    "point_cloud_message": lambda of: (point_cloud_message, {"points": [], "time": 0.0}),
    "points_of_message": lambda of: (points_of_message, {"message": point_cloud_message([], 0.0)}),
    "Settings": lambda of: (Settings, {}),
    "Durations": lambda of: (Durations, {}),
    "Durations.of_step": lambda of: (Durations.of_step, {"total": 10.0}),
    "Plan.save": lambda of: (of["plan"].save, {"path": "saved.json"}),
    "Plan.load": lambda of: (Plan.load, {"path": of["folder"] / "plan.json"}),
    "GraspMap.load": lambda of: (GraspMap.load, {"path": of["folder"] / "map.json"}),
    "GraspMap.sparse": lambda of: (of["map"].sparse, {"seed": 0}),
    "GraspMap.check_goal": lambda of: (of["map"].check_goal, {"goal": of["goal"]}),
    "jem_map": lambda of: (jem_map, {"spacing": 0.5}),
    "RobotSpec.with_failed_joint": lambda of: (
        robot_spec("mlivr2-iiwa").with_failed_joint,
        {"limb": 0, "joint": 5, "angle": 0.3},
    ),
    "Physics": lambda of: (Physics, {}),
    "ControllerParameters": lambda of: (ControllerParameters, {}),
    "DisturbanceRanges": lambda of: (DisturbanceRanges, {}),
    "Limits": lambda of: (Limits, {}),
    "Cargo": lambda of: (Cargo, {"mass": 1.0, "size": 0.2}),
    "robot_spec": lambda of: (robot_spec, {"robot": "mlivr2"}),
    "save_csv": saved(save_csv),
    "save_npz": saved(save_npz),
    "save_ros": saved(save_ros),
    "exported_model": lambda of: (exported_model, {**scene(of), **held(of)}),
    "plan_figure": lambda of: (plan_figure, {**drawn(of), "path": "plan.png"}),
    "SceneRenderer": lambda of: (SceneRenderer, small_scene(of)),
    "SceneRenderer.render": lambda of: (
        SceneRenderer(**small_scene(of)).render,
        {**standing(of), "camera": Camera((0.0, 0.0, 0.0)), "route": of["route"]},
    ),
    "film": lambda of: (film, {**scene(of), "recording": of["recording"], **FILM}),
}
"""Each function, and what it is called with where it is called right."""

WHOLE_MODULE = {("MlivrEnv", "map"), ("MlivrVectorEnv", "env"), ("stance_graph", "grasp_map")}
"""Arguments that stand for the whole module where they are None, which takes long."""


def names_of(function):
    """Names of the arguments of a function."""
    rest = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    signature = inspect.signature(function)
    return [name for name, one in signature.parameters.items() if one.kind not in rest]


def called(function, good):
    """Calls a function, and goes through what it yields."""
    with suppress(gymnasium.error.DependencyNotInstalled):  # films need MoviePy
        came = function(**good)
        if inspect.isgenerator(came):
            list(came)


@pytest.mark.filterwarnings("ignore:.*Overwriting existing videos")
@pytest.mark.parametrize("title", FUNCTIONS)
def test_an_argument_is_taken_or_refused_in_one_line(things, title):
    function, good = FUNCTIONS[title](things)
    called(function, good)
    wrong, refused = [], 0
    for name in names_of(function):
        for value in given_values():
            if value is None and (title, name) in WHOLE_MODULE:
                continue
            call = partial(called, function, {**good, name: value})
            try:
                refused += answer(call, name, ALSO.get(name, ())) is not None
            except (Exception, AssertionError) as error:
                told = f"{type(error).__name__} {str(error)[:200]!r}"
                wrong.append(f"{name} = {shortened(value)}: {told}")
    assert not wrong, "\n".join([str(len(wrong)), *wrong])
    assert refused > 20 * len(names_of(function))


@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("name", names_of(MlivrEnv))
def test_gymnasium_tells_the_same(things, name):
    """Through `make`, in whose place Gymnasium has errors of its own for a `render_mode`."""
    value = "deck" if name == "render_mode" else b"x"
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(MlivrError) as caught:
            make("MLIVR-JEM-v0", **({"map": things["map"]} | {name: value}))
        assert name in str(caught.value) or (name, make) == ("render_mode", gymnasium.make_vec)


@pytest.mark.parametrize("name", ["start", "start_pose", "start_joints", "goal", "task"])
def test_an_option_is_taken_or_refused_in_one_line(things, name):
    also = (*ALSO["start"], "tasks")
    rest = {"start": things["start"]} if "_" in name else {}
    for value in (value for value in given_values() if value is not None):
        for env in (things["env"], things["copies"]):
            for given in (value, [value], [value] * 2, (value,) * 7):
                answer(partial(env.reset, options={**rest, name: given}), name, also)


def test_a_start_of_a_plan_is_taken_or_refused_in_one_line(things):
    also, plan = (*ALSO["start"], "branch sets", "state"), things["planner"].plan
    for value in (value for value in given_values() if value is not None):
        for given in ([value] * 2, State((value,) * 2, (1, 1)), State((0, 1), (value,) * 2)):
            answer(partial(plan, given, things["goal"]), "start", also)

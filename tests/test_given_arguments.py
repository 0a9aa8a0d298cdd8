"""Whatever is given for an argument of the API reference, it is taken, or refused in one line.

Each argument of each callable in turn gets wrong values of every type, the others right ones. The
callables and the names of their arguments are those of the reference, so that new ones are tested
too. Each argument gets a few of the values, drawn with a fixed seed; in `make slow` it gets all.
"""

import gc
import inspect
import io
import random
import warnings
from contextlib import redirect_stderr, suppress
from functools import cache, partial

import gymnasium
import numpy as np
import pytest
from fuzz import answer, bounded, given_values
from good_arguments import bound, good
from public_api import PAGES, callables, parameters
from things import Things

from mlivr_gym import MlivrError, State
from mlivr_gym.compiled.cache import CACHE_VARIABLE
from mlivr_gym.envs.env import MlivrEnv
from mlivr_gym.errors import shortened
from mlivr_gym.files import write_whole
from mlivr_gym.pictures.map_views import MapViews
from mlivr_gym.pictures.rendering import SceneRenderer

DRAWN = 2
"""How many values each argument gets in the short form."""

MOST_SECONDS = 100.0
"""Processor time that one call may take [s], with code that it compiles."""

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
    "keep": ("graspable point", "ids"),
    "ids": ("faces",),
    "point": ("graspable point",),
    "now": ("present time",),
    "stance": ("graspable point",),
    "after": ("stance",),
    "candidates": ("map",),
    "dataset_id": ("data set",),
    "data": ("plan", "map", "robot", "fields", "box", "kind"),
    "mounts": ("limbs",),
    "mask": ("actions",),
    "low": ("min",),
    "radius": ("half",),
    "locked_joint": ("locked_angle",),
    "high": ("max",),
    "stances": ("stance",),
    "state": ("before",),
    "present": ("base position", "base quaternion", "joint angles", "configuration"),
    "path": ("cannot write", "cannot read", "file", "mesh", "obstacles", "plan", "hyperparameters"),
}
"""What messages call some arguments besides their names."""

COMMON = (
    "graspable point", "stance", "obstacle", "checkpoint", "found on map", "policy",
    "needs a screen", "cannot hold it", "cannot write", "exists already",
)  # fmt: skip
"""What messages about what an argument names call it."""

NEEDS_MORE = {"SceneWindow", "RecordVideo"}
"""Classes that need a screen or a package; what they are given is checked before."""

NO_ANSWER = {"CargoMission.execute", "plan_cargo_mission", "after_failure"}
"""Callables that have no answer on a small map, where no limb can carry a bag; nor has a
limb of six joints one to spare."""

TAKES_LONG = {
    ("MlivrEnv", "map"), ("ClosedLoopEnv", "map"), ("UnknownMapEnv", "map"),
    ("MlivrVectorEnv", "env"), ("stance_graph", "grasp_map"),
    ("train", "env"), ("train", "hyperparameters"), ("write_dataset", "env_arguments"),
    ("write_lerobot_dataset", "env_arguments"),
}  # fmt: skip
"""Arguments that stand for much, such as the whole module, where they are None."""

NUMBERS = ((1, True), (0, False), ([0, 1], [False, True]), ([1.0, 0.0, 1.0], [True, False, True]))
"""Numbers, and what Python takes for them."""

CALLED_OFTEN = {"State.stance_after", "Successors.find", "Successors.take"}
"""What checks its arguments only where it fails."""

FREE = {
    "command", "face", "file", "folder", "id", "name", "name_prefix", "out", "path", "source",
    "title", "video_folder",
}  # fmt: skip
"""Arguments that may be any text; the others are one of some names."""


@pytest.fixture(scope="module", autouse=True)
def own_folder(tmp_path_factory):
    """Tables and files of these tests go to folders of their own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, str(tmp_path_factory.mktemp("cache")))
        # What is drawn is not looked at here.
        drawn = "mlivr_gym.pictures.plan_figures"
        for name in ("solids", "base_path"):
            patch.setattr(f"{drawn}.MapViews.{name}", lambda *_, **__: None)
        patch.setattr(f"{drawn}.save_figure", lambda figure, path, **_: write_whole(path, b""))
        patch.setattr(f"{drawn}.MapViews", cache(MapViews))
        picture = np.zeros((16, 32, 3), np.uint8)
        for name in ("pictures.films", "extensions.closed_loop.film"):
            patch.setattr(f"mlivr_gym.{name}.film_pictures", lambda *_, **__: [picture])
        yield patch


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "minari"))


@pytest.fixture(scope="module")
def things(small_map, own_folder, tmp_path_factory):
    """What the functions are called with where they are called right."""
    few = small_map.subset(np.arange(len(small_map)) % 3 == 0, "few")
    made = Things(few, tmp_path_factory.mktemp("files"))
    own_folder.setattr("mlivr_gym.envs.env.stance_graph", made.graph_once)
    with suppress(ImportError):
        own_folder.setattr("mlivr_gym.agents.test_set.jem_map", lambda *_: few)
    yield made
    vars(made).clear()
    gc.collect()


def called(function, given):
    """Calls a function, and goes through what it yields."""
    with (
        bounded(MOST_SECONDS),
        redirect_stderr(io.StringIO()),
        warnings.catch_warnings(),
        suppress(gymnasium.error.DependencyNotInstalled, gymnasium.error.ResetNeeded),
    ):
        warnings.simplefilter("ignore")
        came = function(**given)
        if inspect.isgenerator(came):
            list(came)
        if isinstance(came, SceneRenderer):
            came.close()


def faults(things, page, drawn=None):
    """What came of wrong values besides answers and refusals, and how many were refused."""
    wrong, refused, asked = [], 0, 0
    for title, function in callables(page).items():
        if title.partition(".")[0] in NEEDS_MORE and "." in title:
            continue
        given, call = good(things, title, function), bound(things, title, function)
        with suppress(*[MlivrError] * (title in NEEDS_MORE | NO_ANSWER)):
            called(call, given)
        for name in parameters(function):
            values = given_values()
            if drawn is not None:
                values = random.Random(f"{title} {name}").sample(values, drawn)
            for value in values:
                if value is None and (title, name) in TAKES_LONG:
                    continue
                asked += 1
                try:
                    tried = partial(called, call, {**given, name: value})
                    refused += answer(tried, name, (*COMMON, *ALSO.get(name, ()))) is not None
                except (Exception, AssertionError) as error:
                    told = f"{type(error).__name__} {str(error)[:200]!r}"
                    wrong.append(f"{title}, {name} = {shortened(value)}: {told}")
                things.put_back()
    return wrong, refused / max(asked, 1)


@pytest.mark.parametrize("drawn", [DRAWN, pytest.param(None, marks=pytest.mark.slow)])
@pytest.mark.parametrize("page", PAGES)
def test_an_argument_is_taken_or_refused_in_one_line(things, page, drawn):
    if page == "agents":
        pytest.importorskip("torch")
    wrong, refused = faults(things, page, drawn)
    assert not wrong, "\n".join([str(len(wrong)), *wrong])
    assert refused > 0.2 or page == "errors"


def is_taken(things, call, given):
    """Whether a callable takes what it is given."""
    try:
        called(call, given)
    except MlivrError:
        return False
    finally:
        things.put_back()
    return True


def arguments(things, page):
    """Of each argument of a page its title, annotation, and a function that tells what it takes.

    What takes any object at all, as records do, is left out.
    """
    if page == "agents":
        pytest.importorskip("torch")
    for title, function in callables(page).items():
        if title in CALLED_OFTEN or (title.partition(".")[0] in NEEDS_MORE and "." in title):
            continue
        given, call = good(things, title, function), bound(things, title, function)
        for name, one in parameters(function).items():

            def takes(value, call=call, given=given, name=name):
                return is_taken(things, call, {**given, name: value})

            if takes(object()):
                continue
            yield f"{title}, {name}", str(one.annotation), takes


@pytest.mark.parametrize("page", PAGES)
def test_neither_a_truth_value_nor_an_unknown_name_is_taken_for_another(things, page):
    """What takes a number refuses a truth value, and what takes one of some names all others."""
    both, taken = [], set()
    for k, (title, annotation, takes) in enumerate(arguments(things, page)):
        both += [(title, truth) for number, truth in NUMBERS if takes(truth) and takes(number)]
        if "str" in annotation and takes(f"no such name {k}"):  # nor a file that was just written
            taken.add(title.rpartition(" ")[2])
    assert not both
    assert taken <= FREE


@pytest.mark.filterwarnings("ignore:.*")
@pytest.mark.parametrize("name", parameters(MlivrEnv))
def test_gymnasium_tells_the_same(things, name):
    """Through `make`, in whose place Gymnasium has errors of its own for a `render_mode`."""
    value = "deck" if name == "render_mode" else b"x"
    for make in (gymnasium.make, gymnasium.make_vec):
        with pytest.raises(MlivrError) as caught:
            make("MLIVR-JEM-v0", **({"map": things.map} | {name: value}))
        assert name in str(caught.value) or (name, make) == ("render_mode", gymnasium.make_vec)


@pytest.mark.parametrize("name", ["start", "start_pose", "start_joints", "goal", "task"])
def test_an_option_is_taken_or_refused_in_one_line(things, name):
    also = (*ALSO["start"], "tasks")
    rest = {"start": things.query["start"]} if "_" in name else {}
    for value in given_values()[1:]:  # without None
        for env in (things["MlivrEnv"], things["MlivrVectorEnv"]):
            for given in (value, [value], [value] * 2, (value,) * 7):
                answer(partial(env.reset, options={**rest, name: given}), name, also)


def test_a_start_of_a_plan_is_taken_or_refused_in_one_line(things):
    also, plan = (*ALSO["start"], "branch sets", "state"), things["Planner"].plan
    for value in given_values()[1:]:
        for given in ([value] * 2, State((value,) * 2, (1, 1)), State((0, 1), (value,) * 2)):
            answer(partial(plan, given, things.query["goal"]), "start", also)

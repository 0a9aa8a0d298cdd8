"""Figures, renderings and films; MuJoCo's scene is the picture of the robot."""

from typing import TYPE_CHECKING

from mlivr_gym.lazy import lazy

if TYPE_CHECKING:
    from mlivr_gym.pictures.camera import Camera
    from mlivr_gym.pictures.captions import with_caption
    from mlivr_gym.pictures.figures import new_figure, save_figure, save_image
    from mlivr_gym.pictures.films import check_film_format, film, film_pictures, save_film
    from mlivr_gym.pictures.plan_figures import plan_figure, walk_figure
    from mlivr_gym.pictures.rendering import SceneRenderer, Shot
    from mlivr_gym.pictures.route import Route
    from mlivr_gym.pictures.simulation_figures import simulation_figure

__all__ = [
    "Camera",
    "Route",
    "SceneRenderer",
    "Shot",
    "check_film_format",
    "film",
    "film_pictures",
    "new_figure",
    "plan_figure",
    "save_figure",
    "save_film",
    "save_image",
    "simulation_figure",
    "walk_figure",
    "with_caption",
]

__getattr__, __dir__ = lazy(__name__)

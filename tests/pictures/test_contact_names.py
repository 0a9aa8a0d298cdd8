"""Contacts are told in words, with the distance that the checks find."""

import numpy as np
import pytest

from mlivr_gym import Box
from mlivr_gym.collisions.contacts import Contact, contacts
from mlivr_gym.pictures.contact_names import contact_sentence, shape_name, witness_points
from mlivr_gym.pictures.robot_shapes import robot_parts
from mlivr_gym.robot.specification import robot_spec
from mlivr_gym.world.boxes import BOX, scene_name


def test_every_box_of_the_module_has_a_name_in_words(jem):
    boxes = {scene_name(BOX, box.id): box for box in jem.boxes}
    assert all("box/" not in shape_name(name, boxes) for name in boxes)


def test_a_contact_is_told_by_its_gap():
    box = Box.between("cargo", "obstacle", (0, 0, 0), (1, 1, 1))
    contact = Contact("limb0/forearm/0", "box/cargo", 0.0)
    boxes = {"box/cargo": box}
    assert contact_sentence(contact, 0.0123, boxes) == "forearm of limb 0 12 mm from obstacle cargo"
    assert (
        contact_sentence(contact, -0.04, boxes) == "forearm of limb 0 40 mm deep in obstacle cargo"
    )


def test_nearest_places_are_as_far_apart_as_the_checks_say(jem):
    """Where no axis runs into a box, the gap is the distance of `contacts`, which coal judges."""
    robot, rng, seen = robot_spec("mlivr2"), np.random.default_rng(3), {True: 0, False: 0}
    for _ in range(6):
        position = rng.uniform(*jem.cabin) * [1.0, 0.6, 0.6]
        turn = rng.normal(size=4)
        here = (position, turn / np.linalg.norm(turn), rng.uniform(-3, 3, (2, 6)))
        shapes = {part.name: part for part in robot_parts(robot, here)}
        shapes |= {scene_name(BOX, box.id): box for box in jem.boxes}
        for contact in contacts(robot, jem.boxes, here, 0.15):
            first, second = shapes[contact.first], shapes[contact.second]
            places = witness_points(first, second)
            between = float(np.linalg.norm(places.second - places.first))
            assert between == pytest.approx(abs(places.gap), abs=1e-9)
            if contact.first != "body" and contact.distance > -first.radius + 1e-6:
                assert places.gap == pytest.approx(contact.distance, abs=1e-4)
                seen[contact.second.startswith(BOX)] += 1
    assert min(seen.values()) > 3


def test_a_capsule_moved_out_of_a_box_by_its_depth_just_touches_it():
    robot, rng, deep = robot_spec("mlivr2"), np.random.default_rng(4), 0
    for _ in range(40):
        here = (np.zeros(3), np.array([1.0, 0, 0, 0]), rng.uniform(-3, 3, (2, 6)))
        parts = {part.name: part for part in robot_parts(robot, here)}
        forearm = parts["limb0/forearm/0"]
        middle = forearm.axes[0].mean(axis=0) + rng.uniform(-0.1, 0.1, 3)
        half = rng.uniform(0.02, 0.2, 3)
        box = Box.between("b", "obstacle", middle - half, middle + half)
        places = witness_points(forearm, box)
        if places.gap > -forearm.radius:
            continue
        deep += 1
        low, high = forearm.axes[0].min(axis=0), forearm.axes[0].max(axis=0)
        out_by = np.minimum(high - (middle - half), (middle + half) - low) + forearm.radius
        assert -places.gap == pytest.approx(out_by.min(), abs=1e-9)  # the shortest way out
        moved = forearm._replace(axes=forearm.axes + places.gap * places.normal)
        out = witness_points(moved, box).gap
        assert out >= -1e-4  # nothing of it is left in the box ...
        nearly = forearm._replace(axes=forearm.axes + 0.98 * places.gap * places.normal)
        assert (nearly.axes[0] @ places.normal).max() + forearm.radius > float(
            places.second @ places.normal
        )  # ... and with less some is still beyond its face
    assert deep > 10

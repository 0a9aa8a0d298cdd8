"""Conversion of actions to integers from the forms in which policies return them."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np

from mlivr_gym.arrays import IntArray
from mlivr_gym.errors import SettingError, shortened


def action_number(action: Any, count: int) -> int:
    """Return an action, an integer of Python or NumPy or an array without axes, as an int.

    A tensor is taken as an array. Raises a `SettingError` if it is none of these, or not from 0 to
    `count` - 1.
    """
    try:
        shape = tuple(getattr(action, "shape", ()))
        # A tensor with one element on an axis would convert to a number too, but it is a batch.
        number = -1 if shape or isinstance(action, bool | np.bool_) else operator.index(action)
    except TypeError:
        shape, number = (), -1
    if not 0 <= number < count:
        given = f"of shape {shape}" if shape else shortened(action)
        raise SettingError(f"action {given} is not a whole number from 0 to {count - 1}")
    return number


def action_numbers(actions: Any, k: int, count: int) -> IntArray:
    """Return a batch of actions, an array, a tensor or a list, as an array, shape (k,).

    Raises a `SettingError` if they are not k integers from 0 to `count` - 1.
    """
    fault, numbers = "", np.zeros(0, dtype=np.int64)
    try:
        array = np.asarray(actions)
    except (TypeError, ValueError) as error:  # a ragged list, a tensor on another device
        array, fault = np.zeros(0), str(error)
    if not fault and array.shape != (k,):
        fault = f"they have shape {array.shape}"
    elif not fault and array.dtype.kind not in "iu":
        fault = f"they are of type {array.dtype}"
    elif not fault:
        numbers = array.astype(np.int64)
        wrong = numbers.view(np.uint64) >= count  # negative numbers become large ones
        if wrong.any():
            fault = f"one is {array[wrong][0]}"
    if fault:
        raise SettingError(
            f"actions must be {k} numbers of Discrete({count}), in integers: {fault}"
        )
    return numbers

"""Largest numbers of what a robot is made of, by which compiled code makes room for it."""

MOST_LIMBS = 8
"""Largest number of limbs of a robot."""

MOST_CAPSULES = 64
"""Largest number of collision shapes of a limb: the compiled checks keep them on the stack."""

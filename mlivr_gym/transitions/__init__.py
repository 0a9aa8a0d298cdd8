"""States, and the check of a step between two stances.

A step moves one limb from a point to another one. It is possible if

* the limb can be released at both stances: it departs along the normal, and changes to a fold or
  another branch, while all else is at rest (`release`);
* the base moves straight from one posture to the other, clear of boxes, and each support follows it
  on a branch that both stances have, clear of all but the limb that moves (`steps`);
* the limb stays in a fold that it has at both stances, or goes on a line above both points, clear
  of the rest (`steps`).

What is kept of the branches is a fact of the two stances; `relaxed_steps` bounds it in less time.
"""

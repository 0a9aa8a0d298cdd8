"""Postures of stances: the base pose, and the branches on which each limb may hold.

What each module knows, from the bottom up:

* `records`: the structures that pass between the kernels.
* `relabelling`: which exchanges of the limbs leave a robot as it is.
* `base_poses`: the grasps of a stance as its first limb sees them (`StanceGeometry`), and its base
  poses by number; `bases_at` recovers those that a table names.
* `reach`: `w_m` of all branches at a base pose, no joint angle formed; the sets of points that some
  order of the limbs reaches.
* `placed_limbs`: limbs on their branches at a base pose: `K^-1`, capsules, distances from the limb
  itself, the body and other limbs, and whether they touch boxes.
* `rule`: enumerates heights, rolls and branches, and chooses one combination (`Posture`).
* `branch_sets`: the branches on which the limbs may hold at that pose, whichever the others take.
* `selection`: both of these for many stances.
* `solver`, `postures`: the public face, `PostureSolver`, which has the robot alone come first and
  then the boxes around it, and the arrays that it returns, `Postures`.
* `given_pose`: checks a base pose and joint angles that the user gives.
"""

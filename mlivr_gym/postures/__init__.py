"""Postures of stances: the base pose, and the branches on which each limb may hold.

What each module knows, from the bottom up:

* `records`: the structures that pass between the kernels.
* `relabelling`: which exchanges of the limbs leave a robot as it is.
* `base_poses`: the grasps of a stance as its first limb sees them (`StanceGeometry`), and its base
  poses by number; `bases_at` recovers those that a table names.
* `reach`: flange poses and `w_m` of all branches at a base pose (`CandidatePose`), no joint angle
  formed; the sets of points that some order of the limbs reaches.
* `gaps`: distances of the limbs on their branches at that pose, from themselves, the body, each
  other and the boxes, each worked out when it is first asked for.
* `rule`: enumerates heights, rolls and branches, and chooses one combination (`Posture`).
* `branch_sets`: the branches on which the limbs may hold at that pose, whichever the others take.
* `selection`: all of this for many stances, first the robot alone, then among the boxes.
* `solver`, `postures`: the public face, `PostureSolver` and the arrays that it returns, `Postures`.
* `given_pose`: checks a base pose and joint angles that the user gives.
"""

"""Commands of the core; those of the extensions follow in the help of the program."""

COMMANDS = {
    "plan": (
        "plan a path from a start stance to a goal position",
        "mlivr-gym plan",
        "mlivr-gym plan --start D2a:4 D2b:4 --goal 6.0 0 0.42 --cost steps --out plan.json",
        "mlivr-gym plan --cost weighted --regrasp-price 0.1 --picture plan.png",
        "mlivr-gym plan --box 3.2 -1.0 -1.0 3.5 1.0 0.3 --occupied D3a:3 D3a:4",
        "mlivr-gym plan --json | jq .steps",
    ),
    "simulate": (
        "execute a plan in MuJoCo",
        "mlivr-gym simulate --case 3 --out walk",
        "mlivr-gym simulate --plan plan.json --no-film --out walk",
    ),
    "table1": (
        "reproduce the four cases of the paper's Table I",
        "mlivr-gym table1 --out results",
    ),
    "info": (
        "describe a map, a robot and their stance graph",
        "mlivr-gym info",
        "mlivr-gym info --map my_map.json --robot my_robot.json --json",
    ),
    "render": (
        "draw the robot in a stance, or a plan",
        "mlivr-gym render --start D2a:4 D2b:4 --out start.png",
        "mlivr-gym render --plan plan.json --out walk.png",
        "mlivr-gym render --plan plan.json --stance 2 --size 1600 800 --mjcf scene.xml",
    ),
    "train": (
        "train a policy",
        "mlivr-gym train --method dagger --out my_policy",
        "mlivr-gym train --method finetune --init my_policy --shaping --out better",
    ),
    "evaluate": (
        "evaluate a policy or a planner",
        "mlivr-gym evaluate --policy astar --episodes 10",
        "mlivr-gym evaluate --policy pretrained --beam 8 --split same",
        "mlivr-gym evaluate --policy my_policy --split occupied --json",
    ),
    "dataset": (
        "write episodes of the expert as a data set of Minari or LeRobot",
        "mlivr-gym dataset --id mlivr/jem/expert-v0 --episodes 200",
        "mlivr-gym dataset --lerobot expert --episodes 10000",
    ),
    "warmup": (
        "compile all that plans run",
        "mlivr-gym warmup",
    ),
    "build": (
        "compute the complete table of a robot on a map",
        "mlivr-gym build --robot my_robot.json",
        "mlivr-gym build --robot mlivr4 --no-collisions --map few_points.json",
    ),
    "doctor": (
        "check this installation: versions, extras, rendering, compiled code",
        "mlivr-gym doctor",
        "mlivr-gym doctor --json",
    ),
}
"""The line of the help and some examples of each command; the module of that name implements it."""

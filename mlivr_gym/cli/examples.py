"""Example command lines that the help of each command shows."""

EXAMPLES = {
    "plan": (
        "mlivr-gym plan",
        "mlivr-gym plan --start D2a:4 D2b:4 --goal 6.0 0 0.42 --cost steps --out plan.json",
        "mlivr-gym plan --cost weighted --regrasp-price 0.1 --picture plan.png",
        "mlivr-gym plan --box 3.2 -1.0 -1.0 3.5 1.0 0.3 --occupied D3a:3 D3a:4",
        "mlivr-gym plan --json | jq .steps",
    ),
    "simulate": (
        "mlivr-gym simulate --case 3 --out walk",
        "mlivr-gym simulate --plan plan.json --no-film --out walk",
    ),
    "walk": (
        "mlivr-gym walk --unknown 3.2 -1.0 -1.0 3.5 1.0 0.3 --picture walk.png",
        "mlivr-gym walk --refusing A4a:4 --disturbances all --out walk.json",
    ),
    "carry": (
        "mlivr-gym carry --robot mlivr3 --cargo 10 0.2 0.2 0.2 --start D3a:8 D3a:1 D3a:4 "
        "--pick D2b:3 --stow F2b:4",
    ),
    "table1": ("mlivr-gym table1 --out results",),
    "info": (
        "mlivr-gym info",
        "mlivr-gym info --map my_map.json --robot my_robot.json --json",
    ),
    "render": (
        "mlivr-gym render --start D2a:4 D2b:4 --out start.png",
        "mlivr-gym render --plan plan.json --out walk.png",
        "mlivr-gym render --plan plan.json --stance 2 --size 1600 800 --mjcf scene.xml",
    ),
    "view": (
        "mlivr-gym view --start D2a:4 D2b:4 --goal 6.0 0 0.42",
        "mlivr-gym view --plan plan.json --out walk.html",
    ),
    "train": (
        "mlivr-gym train --method dagger --out my_policy",
        "mlivr-gym train --method finetune --init my_policy --shaping --out better",
    ),
    "evaluate": (
        "mlivr-gym evaluate --policy astar --episodes 10",
        "mlivr-gym evaluate --policy pretrained --beam 8 --split same",
        "mlivr-gym evaluate --policy my_policy --split occupied --json",
    ),
    "benchmark": (
        "mlivr-gym benchmark run --policy my_module:act --budget planner --out my_entry",
        "mlivr-gym benchmark check my_entry",
        "mlivr-gym benchmark table my_entry benchmark/greedy",
    ),
    "study": (
        "mlivr-gym study thresholds.toml",
        "mlivr-gym study thresholds.toml --engine dask --scheduler tcp://10.0.0.1:8786",
    ),
    "dataset": ("mlivr-gym dataset --id mlivr/jem/expert-v0 --episodes 200",),
    "warmup": ("mlivr-gym warmup",),
    "build": (
        "mlivr-gym build --robot my_robot.json",
        "mlivr-gym build --robot mlivr4 --no-collisions --map few_points.json",
    ),
    "cache": ("mlivr-gym cache", "mlivr-gym cache --limit 2GB", "mlivr-gym cache --clear"),
    "doctor": ("mlivr-gym doctor", "mlivr-gym doctor --json"),
}
"""Example command lines of each command."""


def examples(*commands: str) -> str:
    """Return the examples of some commands as the last paragraph of a help text."""
    lines = [line for command in commands for line in EXAMPLES[command]]
    return "examples:\n" + "".join(f"  {line}\n" for line in lines)

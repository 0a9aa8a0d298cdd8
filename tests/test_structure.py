"""The rule of imports, and the sizes that keep a file readable; all told from parsed sources."""

import ast
import re
from functools import cache
from pathlib import Path

import networkx

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "mlivr_gym"

LAYERS = (
    {"experiments", "__main__"},
    {"an extension"},
    {"cli"},
    {"agents"},
    {"envs"},
    {"pictures"},
    {"planners", "simulation"},
    {"motion", "paper"},
    {"stances"},
    {"transitions"},
    {"postures"},
    {"collisions"},
    {"robot"},
    {"world"},
    {"kinematics", "settings", "files"},
    {"arguments"},
    {"schema", "engines"},
    {"values", "extras"},
    {"compiled", "errors", "sharing"},
    {"envs_assets", "extensions", "lazy", "_version", "_headless", "_interrupts", "arrays"},
)
"""From the top down; what stands in one line does not import its neighbours either."""

AMBIGUOUS = {
    "settle", "settled", "left", "land", "lands", "landed", "landing", "linked", "carried",
    "raised",
    "own", "near", "beyond", "way", "ways", "bodies", "hindrance", "reliability",
}  # fmt: skip
"""Words that meant several things here; `docs/glossary.md` has one word for each."""

LEVEL = {name: len(LAYERS) - k for k, line in enumerate(LAYERS) for name in line}
MOST_LINES, MOST_FUNCTION_LINES, MOST_PARAMETERS = 400, 60, 6
MOST_OF_KERNELS, MEAN_OF_KERNELS = 8, 4.0
"""Parameters of a kernel, at most and on average."""

PRIVATE = {"compiled.kernels", "compiled.machine_code"}
"""What may use something private of the compiler; it says what and why."""


@cache
def sources():
    names = "mlivr_gym", "planners", "agents", "envs_assets", "experiments"
    folders = [ROOT / name for name in names]
    paths = {path.resolve() for folder in folders for path in folder.rglob("*.py")}
    return sorted(paths)


@cache
def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def module_of(path):
    """Name of a module below `mlivr_gym`; three folders lie at the top of the repository."""
    base = PACKAGE if path.is_relative_to(PACKAGE) else ROOT
    parts = path.relative_to(base).with_suffix("").parts
    return ".".join(part for part in parts if part != "__init__")


@cache
def known_modules():
    return {module_of(path) for path in sources()}


@cache
def all_imports_of(path):
    """Modules, and what is taken from them, that a file imports anywhere, for types alone too."""
    found = set()
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module)
            found.update(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def imports_of(path):
    """Modules of the project that a file imports."""
    found = all_imports_of(path)
    inside = {name.removeprefix("mlivr_gym.") for name in found if name.startswith("mlivr_gym.")}
    return inside & known_modules()


def part_of(module):
    """The line of `LAYERS` on which a module stands; `extensions` itself only lists folders."""
    first, *rest = module.split(".")
    return "an extension" if first == "extensions" and rest else first


def functions(path):
    """Functions of a file, the outermost of nested ones, with their class."""
    for node in tree_of(path).body:
        if isinstance(node, ast.FunctionDef):
            yield node.name, node, False
        elif isinstance(node, ast.ClassDef):
            for inner in node.body:
                if isinstance(inner, ast.FunctionDef):
                    yield f"{node.name}.{inner.name}", inner, True


def is_kernel(node):
    marks = [mark.func if isinstance(mark, ast.Call) else mark for mark in node.decorator_list]
    names = {mark.id for mark in marks if isinstance(mark, ast.Name)}
    return bool(names & {"kernel", "part", "entry", "late_entry", "njit"})


def names_given(path):
    """Names that a file gives: functions, classes, parameters, variables and attributes."""
    for node in ast.walk(tree_of(path)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            yield node.name
        elif isinstance(node, ast.arg):
            yield node.arg
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.id
        elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
            yield node.attr


def test_names_use_words_of_one_meaning():
    found = set()
    for path in sources():
        for name in set(names_given(path)):
            words = re.sub(r"([a-z])([A-Z])", r"\1_\2", name).lower().split("_")
            found |= {(module_of(path), name)} if AMBIGUOUS.intersection(words) else set()
    assert not found


def test_each_class_has_a_name_of_its_own():
    """A name means one thing, whichever file a reader comes from; experiments are scripts."""
    places = {}
    for path in sources():
        module = module_of(path)
        for node in [] if module.startswith("experiments") else tree_of(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(module)
    assert not {name: modules for name, modules in places.items() if len(modules) > 1}


def test_imports_run_downwards_only():
    """The top of the package alone collects what users import from it."""
    upward = set()
    for path in sources():
        module = module_of(path)
        here = part_of(module)
        for other in imports_of(path) if module else ():
            there = part_of(other)
            upward |= {(module, other)} if there != here and LEVEL[there] >= LEVEL[here] else set()
    assert not upward


def test_an_extension_imports_no_other():
    extension = re.compile(r"extensions\.\w+")
    for path in sources():
        here = extension.match(module_of(path))
        others = {found[0] for found in map(extension.match, imports_of(path)) if found}
        assert not here or others <= {here[0]}


MOST_OF_EXTENSIONS = {"closed_loop": 1800, "viewer": 1000, "benchmark": 640}
"""Lines of an extension, else 600."""


def test_extensions_are_small():
    lines = {}
    for path in (PACKAGE / "extensions").glob("*/*.py"):
        count = len(path.read_text(encoding="utf-8").splitlines())
        lines[path.parent.name] = lines.get(path.parent.name, 0) + count
    assert not {name: n for name, n in lines.items() if n > MOST_OF_EXTENSIONS.get(name, 600)}


def test_an_arm_is_asked_through_its_inverse_kinematics_alone():
    """A closed form can be added, or changed, without a look at what uses it; one uses another."""
    forms = {f"kinematics.{name}" for name in ("three_parallel", "spherical_wrist", "numeric")}
    asking = {module_of(path) for path in sources() if forms & imports_of(path)}
    assert asking - forms == {"kinematics.inverse"}


def test_what_results_are_compared_with_is_needed_by_tests_and_experiments_alone():
    """Nor is it named for an import by its name."""
    for path in sources():
        if not path.is_relative_to(ROOT / "experiments"):
            names = {name.split(".")[0] for name in all_imports_of(path)}
            words = {n.value for n in ast.walk(tree_of(path)) if isinstance(n, ast.Constant)}
            assert not {"coal", "pinocchio", "ssik"} & (names | words), path


def test_no_circle():
    """What a package shows is imported when it is asked for (`lazy`)."""
    graph = networkx.DiGraph()
    for path in sources():
        if path.name == "__init__.py":
            continue
        graph.add_edges_from((module_of(path), other) for other in imports_of(path))
    parts = networkx.strongly_connected_components(graph)
    assert not [sorted(part) for part in parts if len(part) > 1]


def lines_of(node):
    """Lines of a function, its docstring aside."""
    first = node.body[0]
    text = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    said = first.end_lineno - first.lineno + 1 if text and isinstance(first.value.value, str) else 0
    return node.end_lineno - node.lineno + 1 - said


def test_files_and_functions_are_short_and_take_few_parameters():
    """Constructors excepted for parameters; options are keyword-only. Ruff looks at the width."""
    long, many = {}, {}
    for path in sources():
        if (count := len(path.read_text(encoding="utf-8").splitlines())) > MOST_LINES:
            long[module_of(path)] = count
        for name, node, method in functions(path):
            place = module_of(path), name
            if lines_of(node) > MOST_FUNCTION_LINES:
                long[place] = lines_of(node)
            count = len(node.args.posonlyargs) + len(node.args.args) - method
            most = MOST_OF_KERNELS if is_kernel(node) else MOST_PARAMETERS
            if count > most and not name.endswith("__init__"):
                many[place] = count
    assert not long
    assert not many


def kernels():
    """Every kernel with its file."""
    return [(path, node) for path in sources() for _, node, _ in functions(path) if is_kernel(node)]


def test_kernels_take_few_parameters_and_read_by_name():
    """Whole numbers as indices are coordinates, or the one row of an array of records."""
    counts, by_position = [], []
    for path, node in kernels():
        assert "fmt: " not in path.read_text(encoding="utf-8"), "it is kept from the formatter"
        counts.append(len(node.args.args))
        for inner in ast.walk(node):
            if isinstance(inner, ast.Subscript) and isinstance(inner.slice, ast.Constant):
                number = inner.slice.value
                if isinstance(number, int) and number > 5:
                    by_position.append((path.name, node.name, ast.unparse(inner)))
    assert not by_position
    assert len(counts) > 100
    assert sum(counts) / len(counts) <= MEAN_OF_KERNELS


def test_nothing_private_of_the_compiler_is_used():
    private = re.compile(r"_nrt|llvmlite|numba\.core\.(?!event)|\._cache\b|\._compile_for_args")
    using = [path for path in sources() if private.search(path.read_text(encoding="utf-8"))]
    assert {module_of(path) for path in using} == PRIVATE


def test_bits_are_taken_apart_in_one_module():
    """Shifts and literals of bits stand in `bit_sets` alone, and in numbers of several sets."""
    allowed = {"compiled.bit_sets", "compiled.limb_branch_sets", "envs.batch"}
    shifting = {
        module_of(path)
        for path, node in kernels()
        for inner in ast.walk(node)
        if isinstance(inner, ast.LShift | ast.RShift)
    }
    assert shifting <= allowed

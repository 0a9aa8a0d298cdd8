"""How the site is built; `make docs` does it, with warnings as errors."""

from __future__ import annotations

import ast
import inspect
import pydoc
import re
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import mlivr_gym
from mlivr_gym.errors import MlivrError

project = "mlivr-gym"
author = "The mlivr-gym developers"
copyright = "The mlivr-gym developers"
release = version = mlivr_gym.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_mock_imports = ["torch", "stable_baselines3", "sb3_contrib", "minari", "dm_env"]
autoclass_content = "both"
napoleon_use_ivar = True
napoleon_use_rtype = False
# Names that two classes have, such as Task, are not linked where they stand in a signature.
suppress_warnings = ["config.cache", "ref.python"]

html_theme = "furo"
html_title = f"mlivr-gym {version}"
html_static_path: list[str] = []
exclude_patterns = ["_build"]

DOCSTRING = re.compile(r"^<!-- docstring ([\w.]+) -->$", re.MULTILINE)
"""Where a page shows the docstring of a class, which is Markdown with NumPy's sections."""

SECTION = re.compile(
    r"^(Attributes|Parameters|Raises|Examples|Returns)\n-+\n((?:(?!## |\w+\n---).*\n)+)",
    re.MULTILINE,
)
ENTRY = re.compile(r"^(\*{0,2}\w+)(?: : .*)?\n((?:    .*\n|\n)+)", re.MULTILINE)


def listed(text: str) -> str:
    """Return a docstring whose NumPy sections have become headings with lists."""

    def section(match: re.Match[str]) -> str:
        name = "Arguments" if match[1] == "Parameters" else match[1]
        if name == "Examples":
            return f"## Example\n\n```python\n{match[2].strip()}\n```\n\n"
        entries = [
            f"* `{entry[1]}`: {' '.join(entry[2].split())}" for entry in ENTRY.finditer(match[2])
        ]
        return f"## {name}\n\n" + "\n".join(entries) + "\n\n"

    return SECTION.sub(section, text + "\n")


def described(name: str) -> str:
    """The docstring of a class and of its constructor as Markdown."""
    found: Any = pydoc.locate(name)
    text = listed(inspect.cleandoc(found.__doc__))
    made = inspect.cleandoc(found.__init__.__doc__ or "")
    arguments = listed(made)
    if "## Arguments" in arguments:
        first = arguments.index("## Arguments")
        last = arguments.find("\n## ", first + 1)
        made = arguments[first : last if last > 0 else None]
        before, history, after = text.partition("## Version History")
        text = f"{before}\n{made}\n{history}{after}"
    return text


PACKAGE = Path(__file__).parent.parent / "mlivr_gym"
"""Where the files lie that pages name."""

PLACE = re.compile(r"^(#+ .*`([\w./]+\.py)::([\w.]+)`)$", re.MULTILINE)
"""A heading that names a function of the package."""


def line_of(path: str, name: str) -> int:
    """The line on which a function or a method of a file begins, by its qualified name."""
    body: list[Any] = ast.parse((PACKAGE / path).read_text(encoding="utf-8")).body
    found: Any = None
    for part in name.split("."):
        found = next((node for node in body if getattr(node, "name", None) == part), None)
        if found is None:
            raise MlivrError(f"{path} has no {name}, which a page names")
        body = found.body
    return int(found.lineno)


def with_lines(text: str) -> str:
    """A page whose headings that name functions tell their lines."""
    return PLACE.sub(lambda match: f"{match[1]} (line {line_of(match[2], match[3])})", text)


FURTHER = re.compile(r"^<!-- further names ([\w.]+) -->$", re.MULTILINE)
"""Where a page of the reference lists the names of a package that it does not describe."""


def constants(package: str) -> dict[str, str]:
    """The docstrings below constants that a package shows."""
    face, found = ast.parse(inspect.getsource(import_module(package))), {}
    for node in ast.walk(face):
        if isinstance(node, ast.ImportFrom):
            body = ast.parse(inspect.getsource(import_module(str(node.module)))).body
            names = {alias.name for alias in node.names}
            for made, text in pairwise(body):
                if isinstance(made, ast.Assign | ast.AnnAssign) and isinstance(text, ast.Expr):
                    kept = {
                        part.id
                        for part in ast.walk(made)
                        if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)
                    }
                    found |= dict.fromkeys(kept & names, ast.literal_eval(text.value))
    return found


def further(package: str, page: str) -> str:
    """The names that a package shows and a page does not describe, with their first sentences."""
    module, texts = import_module(package), constants(package)
    names = [name for name in module.__all__ if not re.search(rf"\b{name}\b", page)]
    docs = {name: texts.get(name) or getattr(module, name).__doc__ for name in names}
    lines = [
        f"* `{name}`: {' '.join(doc.split(chr(10) * 2)[0].split())}" for name, doc in docs.items()
    ]
    return "\n".join(["The package also shows, for extensions and experiments:", "", *lines])


def filled(app: Any, docname: str, source: list[str]) -> None:
    """Put docstrings, names and lines where pages ask for them."""
    text = DOCSTRING.sub(lambda match: described(match[1]), source[0])
    source[0] = with_lines(FURTHER.sub(lambda match: further(match[1], text), text))


PAGES = {
    "mlivr_gym.envs.MlivrEnv": "MLIVR-JEM-v0",
    "mlivr_gym.envs.MlivrVectorEnv": "Vector environment",
}
"""Classes whose docstrings are pages of their own."""


def refer(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """In the reference, name the page of a class that has one in place of its docstring."""
    if name in PAGES:
        lines[:] = [f"See the page *{PAGES[name]}* of the environments."]


def setup(app: Any) -> None:
    """Connect both; words before a colon in an attribute's docstring are no type."""
    from sphinx.ext.napoleon.docstring import GoogleDocstring

    GoogleDocstring._parse_attribute_docstring = GoogleDocstring._consume_to_end
    app.connect("source-read", filled)
    app.connect("autodoc-process-docstring", refer, priority=0)

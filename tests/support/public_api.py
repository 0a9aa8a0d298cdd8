"""Everything callable in the API reference: functions, classes and their methods."""

import inspect
import re
from importlib import import_module
from pathlib import Path

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"

ENTRY = re.compile(
    r"\.\. auto(module|class):: (\S+)\n(?:   :members:(.*)\n)?(?:   :exclude-members:(.*))?"
)
"""A module with its members, or a class with its methods; all of them where none is named."""

PAGES = sorted(page.stem for page in REFERENCE.glob("*.md") if page.stem != "index")
"""The pages of the reference."""

REST = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)


def members(page):
    """The functions and classes of a page, each with the names of its public methods."""
    found = {}
    text = (REFERENCE / f"{page}.md").read_text(encoding="utf-8")
    for kind, name, *listed in ENTRY.findall(text):
        chosen, hidden = (re.findall(r"\w+", names) for names in listed)
        path, _, last = name.rpartition(".")
        if kind == "class":
            found[getattr(import_module(path), last)] = chosen
            continue
        module = import_module(name)
        own = [n for n, one in vars(module).items() if getattr(one, "__module__", "") == name]
        for one in (getattr(module, n) for n in chosen or own if not n.startswith("_")):
            if inspect.isfunction(one):
                found |= {one: []} if one.__name__ not in hidden else {}
            elif inspect.isclass(one):
                methods = [n for n, method in vars(one).items() if is_method(n, method)]
                found[one] = [n for n in methods if n not in hidden]
    return found


def is_method(name, one):
    """Whether an attribute of a class is a public method."""
    method = isinstance(one, (classmethod, staticmethod)) or inspect.isfunction(one)
    return method and not name.startswith("_")


def is_made_elsewhere(one):
    """Whether a class is an error, a protocol, abstract, or a name for data of Python's own."""
    kinds = issubclass(one, BaseException) or getattr(one, "_is_protocol", False)
    return kinds or inspect.isabstract(one) or not one.__module__.startswith("mlivr_gym")


def callables(page):
    """Each callable of a page by a title: that of a method is `Class.method`, also of a base."""
    known, found = members(page), {}
    for one in known:
        if inspect.isclass(one) and is_made_elsewhere(one):
            continue
        found[one.__name__] = one
        for base in getattr(one, "__mro__", ()):
            for name in known.get(base, ()):
                found.setdefault(f"{one.__name__}.{name}", getattr(one, name))
    return found


def parameters(function):
    """The arguments of a callable by name, those without a name of their own left out."""
    return {
        name: one
        for name, one in inspect.signature(function).parameters.items()
        if one.kind not in REST and name != "self"
    }

"""The order of the source tree, by parsing it: imports, sizes, names and limits.

Nothing is imported here, so that a module that cannot be imported is still checked.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGE = "stcalib_ros"
CORE = f"{PACKAGE}.core"

STAGES = (
    *("errors", "model", "options", "geometry", "lifting", "registration", "integration"),
    *("bundle", "control", "refinement", "reconstruction", "paper", "validation", "output"),
    *("stages", "solution", "methods", "pipeline", "diagnosis", "capture", "evaluation"),
)
"""Parts of core/ from the bottom up: each imports only from those before it (and itself)."""

SEPARATE = {"reconstruction": {"refinement"}}
"""Parts that do not know each other although one stands before the other."""

ALSO = {
    "capture": ("monitoring.lenses", "monitoring.matching"),
    "evaluation": ("synthetic",),
    "synthetic": ("errors", "model", "geometry"),
    "monitoring": ("errors", "model", "options", "geometry", "lifting", "integration.association"),
}
"""Of ``synthetic`` and ``monitoring``, which stand beside that order, all that they import.

Of ``evaluation``, what it imports in addition: the truth of simulated scenes.
"""

MAX_MODULE_LINES = 400
MAX_FUNCTION_LINES = 40
"""Lines of code of a function: docstring, comments and blank lines do not count."""

MIN_LIMIT_DOC = 40
"""Characters below which a docstring cannot say unit, meaning and origin of a number."""

CALLED_FROM_OUTSIDE = {
    "excerpt": "cuts a recording in time: for users, benchmarks and tests",
    "camera_from_arrays": "public interface",
}
"""Public functions of core/ that nothing in the package calls, with the reason."""

TREE = sorted((ROOT / PACKAGE).rglob("*.py"))


def dotted(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


MODULES = {dotted(path): path for path in TREE}


@cache
def parsed(module: str) -> ast.Module:
    return ast.parse(MODULES[module].read_text())


def imported(module: str) -> Iterator[str]:
    """Modules of ours that a module imports, wherever in it; submodules by their own name."""
    for node in ast.walk(parsed(module)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in MODULES)
        elif isinstance(node, ast.ImportFrom) and node.module in MODULES:
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                yield name if name in MODULES else str(node.module)


IMPORTS = {module: set(imported(module)) - {module} for module in MODULES}
IMPORTS[PACKAGE] = set()  # its imports are for type checkers and run when a name is first used


def below_core(module: str) -> str:
    """Name below core/, such as ``geometry.lens``; empty outside of it and for core/ itself."""
    return module.removeprefix(f"{CORE}.") if module.startswith(f"{CORE}.") else ""


def may_import(module: str, other: str) -> bool:
    """Whether one module below core/ may import another."""
    part = module.split(".", maxsplit=1)[0]
    allowed = {part, *ALSO.get(part, ())}
    if part in STAGES:
        allowed |= set(STAGES[: STAGES.index(part)]) - SEPARATE.get(part, set())
    return other in allowed or other.split(".", maxsplit=1)[0] in allowed


def test_every_part_of_core_has_its_place_in_the_order() -> None:
    parts = {name.split(".")[0] for module in MODULES if (name := below_core(module))}
    assert parts == {*STAGES, "synthetic", "monitoring"}


def test_no_module_imports_itself_by_way_of_others() -> None:
    """Repeatedly take away modules that import none of the rest: what stays is in a cycle."""
    rest = dict(IMPORTS)
    while free := [module for module, needed in rest.items() if not needed & rest.keys()]:
        for module in free:
            del rest[module]
    assert {m: sorted(n & rest.keys()) for m, n in rest.items()} == {}


def test_stages_import_only_stages_before_them() -> None:
    upward = {
        f"{module} -> {needed}"
        for module, all_needed in IMPORTS.items()
        for needed in all_needed
        if (name := below_core(module)) and (other := below_core(needed))
        if not may_import(name, other)
    }
    assert upward == set()


def test_core_knows_nothing_of_files_ros_reports_and_commands() -> None:
    outside = [
        f"{module} -> {needed}"
        for module, all_needed in IMPORTS.items()
        if module.startswith(CORE)
        for needed in all_needed
        if not needed.startswith(CORE)
    ]
    assert not outside


def test_modules_and_functions_are_short() -> None:
    long = {m for m in MODULES if len(MODULES[m].read_text().splitlines()) > MAX_MODULE_LINES}
    long |= {
        f"{module}.{node.name}"
        for module in MODULES
        for node in ast.walk(parsed(module))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        if code_lines(module, node) > MAX_FUNCTION_LINES
    }
    assert long == set()


def code_lines(module: str, function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines from ``def`` to the end without docstring, comments and blank lines."""
    numbers = set(range(function.lineno, (function.end_lineno or 0) + 1))
    if ast.get_docstring(function) is not None:
        text = function.body[0]
        numbers -= set(range(text.lineno, (text.end_lineno or 0) + 1))
    lines = MODULES[module].read_text().splitlines()
    return sum(not re.fullmatch(r"\s*(#.*)?", lines[number - 1]) for number in numbers)


def test_no_class_name_is_defined_twice() -> None:
    names = Counter(
        node.name
        for module in MODULES
        for node in ast.walk(parsed(module))
        if isinstance(node, ast.ClassDef)
    )
    assert {name for name, count in names.items() if count > 1} == set()


def is_number(value: ast.expr | None) -> bool:
    """Whether an expression is made of numbers: 0.5, (1, 2), 2 * OTHER, np.radians(10.0)."""
    nodes = ast.walk(value) if value is not None else ()
    constants = [n.value for n in nodes if isinstance(n, ast.Constant)]
    numbers = [c for c in constants if isinstance(c, int | float) and not isinstance(c, bool)]
    return bool(numbers) and not any(isinstance(c, str | bytes) for c in constants)


def numeric_constants(module: str) -> Iterator[tuple[str, str]]:
    """Names of the numeric constants of a module, each with the string under it."""
    for statement, following in pairwise([*parsed(module).body, ast.Pass()]):
        if isinstance(statement, ast.Assign):
            target = statement.targets[0]
        elif isinstance(statement, ast.AnnAssign):
            target = statement.target
        else:
            continue
        if isinstance(target, ast.Name) and target.id.isupper() and is_number(statement.value):
            yield target.id, documentation_of(following)


def documentation_of(statement: ast.stmt) -> str:
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return str(statement.value.value)
    return ""


def test_numbers_say_their_unit_meaning_and_origin() -> None:
    silent = {
        f"{module}.{name}"
        for module in MODULES
        if module.startswith((CORE, f"{PACKAGE}.ros"))
        for name, text in numeric_constants(module)
        if len(text) < MIN_LIMIT_DOC
    }
    assert silent == set()


def test_comparisons_are_with_numbers_that_have_a_name() -> None:
    """But for 0, 1 and 2 (fewer than two cameras, two views make a point), and for shapes."""
    unnamed = {
        f"{module}:{node.lineno}"
        for module in MODULES
        for node in ast.walk(parsed(module))
        if isinstance(node, ast.Compare) and "shape" not in (text := ast.unparse(node))
        if "ndim" not in text and any(is_telling(side) for side in [node.left, *node.comparators])
    }
    assert unnamed == set()


def is_telling(side: ast.expr) -> bool:
    """Whether one side of a comparison is a literal number other than 0, 1 and 2."""
    if isinstance(side, ast.UnaryOp):
        side = side.operand
    return is_number(side) and isinstance(side, ast.Constant) and side.value not in (0, 1, 2)


def test_the_package_itself_calls_every_public_function_of_core() -> None:
    """What only tests and benchmarks call belongs to them, or to evaluation/ and synthetic/."""
    mentioned = {name for module in MODULES for name in names_mentioned(parsed(module))}
    idle = {
        node.name
        for module in MODULES
        if below_core(module).split(".")[0] not in ("", "evaluation", "synthetic")
        for node in parsed(module).body
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_")
    } - mentioned
    assert idle == set(CALLED_FROM_OUTSIDE)


def names_mentioned(tree: ast.AST) -> Iterator[str]:
    """Names that code reads, attributes included; definitions and imports are no use yet."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.Attribute):
            yield node.attr

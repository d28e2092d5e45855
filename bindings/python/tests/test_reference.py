"""The reference page of the Python API, generated from the package and its type stub."""

import ast
import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "bindings/python/python/ballast"
PAGE = ROOT / "docs/src/reference/python.md"
HEAD = """# Python API

Generated from the package and its type stub; `make docs` writes this page. SI units; world axes, z up; quaternions x, y,
z, w; times in ns.
"""


def doc(node: ast.ClassDef | ast.FunctionDef) -> str:
    return (ast.get_docstring(node) or "").strip()


def in_cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def signature(function: ast.FunctionDef) -> str:
    """Name, parameters without `self` and annotations, and type of the result."""
    arguments = function.args
    for argument in arguments.posonlyargs + arguments.args + arguments.kwonlyargs:
        argument.annotation = None
    shown = ", ".join(part for part in ast.unparse(arguments).split(", ") if part not in ("self", "/"))
    returns = ast.unparse(function.returns) if function.returns else "None"
    return f"{function.name}({shown}) -> {returns}"


def is_property(function: ast.FunctionDef) -> bool:
    return any(isinstance(d, ast.Name) and d.id == "property" for d in function.decorator_list)


def class_section(node: ast.ClassDef) -> str:
    functions = [f for f in node.body if isinstance(f, ast.FunctionDef)]
    shown = [f for f in functions if not f.name.startswith("_") or f.name == "__init__"]
    fields = [f for f in node.body if isinstance(f, ast.AnnAssign) and isinstance(f.target, ast.Name)]
    bases = ", ".join(ast.unparse(base) for base in node.bases)
    text = f"\n## {node.name}\n\n" + (f"Base: `{bases}`\n\n" if bases else "") + f"{doc(node)}\n"
    rows = [(ast.unparse(f.target), ast.unparse(f.annotation), "") for f in fields]
    for function in filter(is_property, shown):
        rows.append((function.name, ast.unparse(function.returns) if function.returns else "", doc(function)))
    if rows:
        text += "\n| attribute | type | meaning |\n|---|---|---|\n"
        text += "".join(f"| `{name}` | `{in_cell(kind)}` | {in_cell(meaning)} |\n" for name, kind, meaning in rows)
    for function in shown:
        if not is_property(function) and (doc(function) or function.name != "__init__"):
            text += f"\n### {node.name}.{function.name}\n\n```text\n{signature(function)}\n```\n\n{doc(function)}\n"
    return text


def public_names(package: ast.Module) -> list[str]:
    """The package's `__all__`."""
    for node in package.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return [str(name) for name in ast.literal_eval(node.value)]
    return []


def page() -> str:
    package = ast.parse((PACKAGE / "__init__.py").read_text())
    nodes = package.body + ast.parse((PACKAGE / "_ballast.pyi").read_text()).body
    public = public_names(package)
    text = HEAD + "\n## Functions\n"
    for function in nodes:
        if isinstance(function, ast.FunctionDef) and function.name in public:
            text += f"\n### {function.name}\n\n```text\n{signature(function)}\n```\n\n{doc(function)}\n"
    for node in nodes:
        if isinstance(node, ast.ClassDef) and node.name in public:
            text += class_section(node)
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"


def test_the_reference_of_the_python_api_is_current() -> None:
    if "BALLAST_WRITE_DOCS" in os.environ:
        PAGE.write_text(page())
    assert PAGE.read_text() == page(), "docs/src/reference/python.md: expected the present API; run `make docs`"


if __name__ == "__main__":
    PAGE.write_text(page())

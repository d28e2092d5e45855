"""The reference page of the Python API, generated from the package and its type stub."""

import ast
import os
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = ROOT / "bindings/python/python/ballast"
#: Files of each module that is imported apart.
MODULES = {
    "couple": ["couple.py"],
    "study": ["study.py"],
    "tables": ["tables.py"],
    "plot": ["plot.py"],
    "view": ["view.py", "_live.py"],
    "gym": ["gym.py"],
}
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


def function_section(function: ast.FunctionDef, module: str = "") -> str:
    return f"\n### {module}{function.name}\n\n```text\n{signature(function)}\n```\n\n{doc(function)}\n"


def class_section(node: ast.ClassDef, module: str = "") -> str:
    functions = [f for f in node.body if isinstance(f, ast.FunctionDef)]
    shown = [f for f in functions if not f.name.startswith("_") or f.name == "__init__"]
    fields = [f for f in node.body if isinstance(f, ast.AnnAssign) and isinstance(f.target, ast.Name)]
    bases = ", ".join(ast.unparse(base) for base in node.bases)
    mark = "###" if module else "##"
    text = f"\n{mark} {module}{node.name}\n\n" + (f"Base: `{bases}`\n\n" if bases else "") + f"{doc(node)}\n"
    rows = [(ast.unparse(f.target), ast.unparse(f.annotation), "") for f in fields]
    for function in filter(is_property, shown):
        rows.append((function.name, ast.unparse(function.returns) if function.returns else "", doc(function)))
    if rows:
        text += "\n| attribute | type | meaning |\n|---|---|---|\n"
        text += "".join(f"| `{name}` | `{in_cell(kind)}` | {in_cell(meaning)} |\n" for name, kind, meaning in rows)
    for function in shown:
        if not is_property(function) and (doc(function) or function.name != "__init__"):
            text += function_section(function, f"{module}{node.name}.").replace("\n###", f"\n{mark}#", 1)
    return text


def public_names(package: ast.Module) -> list[str]:
    """The package's `__all__`."""
    for node in package.body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return [str(name) for name in ast.literal_eval(node.value)]
    return []


def is_listed(node: ast.ClassDef | ast.FunctionDef, chosen: list[str]) -> bool:
    """True if a name is among those chosen, or if none are and it is public."""
    return bool(doc(node)) and (node.name in chosen if chosen else not node.name.startswith("_"))


def module_section(name: str, files: list[ast.Module]) -> str:
    """Functions and classes of a module: those of its `__all__`, else those without an underscore."""
    text, chosen = f"\n## ballast.{name}\n\n{(ast.get_docstring(files[0]) or '').strip()}\n", public_names(files[0])
    for node in (node for file in files for node in file.body):
        if isinstance(node, ast.FunctionDef) and is_listed(node, chosen):
            text += function_section(node, f"{name}.")
        elif isinstance(node, ast.ClassDef) and is_listed(node, chosen):
            text += class_section(node, f"{name}.")
    return text


def page() -> str:
    package = ast.parse((PACKAGE / "__init__.py").read_text())
    nodes = package.body + ast.parse((PACKAGE / "_ballast.pyi").read_text()).body
    public = public_names(package)
    text = HEAD + "\n## Functions\n"
    for function in nodes:
        if isinstance(function, ast.FunctionDef) and function.name in public:
            text += function_section(function)
    for node in nodes:
        if isinstance(node, ast.ClassDef) and node.name in public:
            text += class_section(node)
    for module, files in MODULES.items():
        text += module_section(module, [ast.parse((PACKAGE / file).read_text()) for file in files])
    return "\n".join(line.rstrip() for line in text.splitlines()) + "\n"


def test_the_reference_of_the_python_api_is_current() -> None:
    if "BALLAST_WRITE_DOCS" in os.environ:
        PAGE.write_text(page())
    assert PAGE.read_text() == page(), "docs/src/reference/python.md: expected the present API; run `make docs`"


if __name__ == "__main__":
    PAGE.write_text(page())

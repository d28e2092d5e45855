"""Prints the licence texts of all crates inside a wheel, and of C libraries that crates carry, each text once.

    python3 scripts/third_party_licences.py MANIFEST...     # with the feature `ballast-hdf5/static`
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

FILE = re.compile("(un)?licen[cs]e|copying|notice|copyright", re.IGNORECASE)
HOST = re.compile(r"^host: (.*)$", re.MULTILINE)


def linked(manifest: str) -> dict[str, tuple[str, Path]]:
    """Returns licence expression and folder of each crate that a package links, by name and version."""
    host = HOST.search(subprocess.run(["rustc", "-vV"], capture_output=True, text=True, check=True).stdout)
    assert host
    command = ["cargo", "metadata", "--locked", "--format-version", "1", "--features", "ballast-hdf5/static"]
    command += ["--filter-platform", host[1], "--manifest-path", manifest]
    found = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    dependencies = {
        node["id"]: [d["pkg"] for d in node["deps"] if any(kind["kind"] is None for kind in d["dep_kinds"])]
        for node in found["resolve"]["nodes"]
    }
    reached, queue = set(), [found["resolve"]["root"]]
    while queue:
        if (package := queue.pop()) not in reached:
            reached.add(package)
            queue += dependencies[package]
    return {
        f"{package['name']} {package['version']}": (package["license"], Path(package["manifest_path"]).parent)
        for package in found["packages"]
        if package["id"] in reached and package["source"]
    }


def main(manifests: list[str]) -> None:
    crates = {name: crate for manifest in manifests for name, crate in linked(manifest).items()}
    users: dict[str, list[str]] = {}
    for name, (_, folder) in sorted(crates.items()):
        texts = {path.read_text(errors="replace").strip() for path in folder.rglob("*") if is_licence(path)}
        for text in sorted(texts):
            users.setdefault(text, []).append(name)
    print("The wheel contains these crates, and the C libraries in some of them:\n")
    for name, (licence, _) in sorted(crates.items()):
        print(f"  {name}: {licence}")
    for text, names in users.items():
        print(f"\n{'=' * 80}\n{', '.join(names)}\n{'-' * 80}\n{text}")


def is_licence(path: Path) -> bool:
    return bool(FILE.match(path.name)) and path.suffix not in {".rs", ".h", ".c", ".py"} and path.is_file()


if __name__ == "__main__":
    main(sys.argv[1:])

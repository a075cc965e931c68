"""Software bill of materials of an installed Fling, from its pinned requirements: CycloneDX 1.6 as JSON.

    python requirements/sbom.py > fling.cdx.json

The same requirements have the same document. Hashes are those of the archives that pip accepts.
"""

from __future__ import annotations

import json
import re
import sys
import tomllib
import uuid
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
PIN = re.compile(r"^(?P<name>[A-Za-z0-9._-]+)==(?P<version>[^ ;\\]+)(?: ; (?P<marker>[^\\]+?))? \\$", re.M)
HASH = re.compile(r"--hash=sha256:([0-9a-f]{64})")
NAMESPACE = uuid.UUID("5f0c1a86-5d0e-4a3b-9a35-3d5a2d0a7d11")  # of serial numbers; drawn once


def bill_of_materials(project: str, requirements: str) -> dict[str, Any]:
    """Returns the document.

    Args:
        project: text of `pyproject.toml`.
        requirements: text of a file of pinned requirements with hashes.
    """
    about = tomllib.loads(project)["project"]
    own = f"pkg:pypi/{about['name']}@{about['version']}"
    components = pinned(requirements)
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.6",
        "serialNumber": f"urn:uuid:{uuid.uuid5(NAMESPACE, about['version'] + requirements)}",
        "version": 1,
        "metadata": {
            "component": {
                "type": "application",
                "bom-ref": own,
                "name": about["name"],
                "version": about["version"],
                "description": about["description"],
                "licenses": [{"license": {"id": about["license"]}}],
                "purl": own,
            }
        },
        "components": components,
        "dependencies": [{"ref": own, "dependsOn": [component["bom-ref"] for component in components]}],
    }


def pinned(requirements: str) -> list[dict[str, Any]]:
    """Returns the component of each requirement, in the order of the file."""
    found = list(PIN.finditer(requirements))
    ends = [*(match.start() for match in found[1:]), len(requirements)]
    components = []
    for match, end in zip(found, ends, strict=True):
        purl = f"pkg:pypi/{match['name']}@{match['version']}"
        hashes = [{"alg": "SHA-256", "content": digest} for digest in HASH.findall(requirements[match.end() : end])]
        component = {
            "type": "library",
            "bom-ref": purl,
            "name": match["name"],
            "version": match["version"],
            "purl": purl,
            "externalReferences": [{"type": "distribution", "url": purl, "hashes": hashes}],
        }
        if match["marker"]:
            component["properties"] = [{"name": "python:marker", "value": match["marker"]}]
        components.append(component)
    return components


def main() -> None:
    """Writes the document to standard output."""
    document = bill_of_materials((ROOT / "pyproject.toml").read_text(), (ROOT / "requirements" / "run.txt").read_text())
    json.dump(document, sys.stdout, indent=2)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()

"""Checks the licences of all dependencies against those that docs/decisions/0018 allows.

    cargo metadata --format-version 1 | licences.py

Prints how many were checked; exit code 1, and the others on stderr, where one is not allowed.
"""

import json
import re
import sys

ALLOWED = {
    "0BSD", "Apache-2.0", "BSD-2-Clause", "BSD-3-Clause", "BSL-1.0", "CC0-1.0", "ISC", "MIT",
    "MIT-0", "MPL-2.0", "Unicode-3.0", "Unicode-DFS-2016", "Unlicense", "Zlib",
}  # fmt: skip


def allowed(expression):
    """Whether allowed licences alone satisfy an SPDX expression; `/` is an old way to write OR."""
    tokens = re.findall(r"[()]|[^\s()]+", expression.replace("/", " OR "))
    at = 0

    def peek():
        return tokens[at] if at < len(tokens) else None

    def take():
        nonlocal at
        at += 1
        return tokens[at - 1]

    def term():
        if peek() is None:
            return False
        token = take()
        if token == "(":
            value = alternatives()
            if peek() == ")":
                take()
            return value
        value = token in ALLOWED
        if peek() == "WITH":  # an exception only ever grants more
            take()
            take()
        return value

    def both():
        value = term()
        while peek() == "AND":
            take()
            value = term() and value
        return value

    def alternatives():
        value = both()
        while peek() == "OR":
            take()
            value = both() or value
        return value

    return alternatives() and at == len(tokens)


def main():
    metadata = json.load(sys.stdin)
    own = set(metadata["workspace_members"])
    others = [package for package in metadata["packages"] if package["id"] not in own]
    bad = [package for package in others if not allowed(package["license"] or "")]
    for package in bad:
        name = f"{package['name']} {package['version']}"
        print(f"{name}: licence {package['license']!r} is not allowed", file=sys.stderr)
    print(f"{len(others)} dependencies, {len(others) - len(bad)} under an allowed licence")
    return 1 if bad or not others else 0


if __name__ == "__main__":
    sys.exit(main())

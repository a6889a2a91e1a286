"""Checks the size and the shape of the source: no file past 500 lines, no line past 100 columns,
no circle of imports between the files of a crate.

usage: structure.py [FOLDER...]   (default: every file that git tracks)

A name that a module only hands on (`pub use`) is followed to the file that defines it, so a
module's face ties no knots. Imports of unit tests do not count. Functions are held to 80 lines by
clippy (`too_many_lines`).
"""

import re
import subprocess
import sys
from pathlib import Path

LINES, COLUMNS = 500, 100
WRAPPED = {".rs", ".py", ".sh", ".toml", ".service", ".target", ".msg", ".css"}
# Tables and links of a page cannot be wrapped, nor can the output of a program that it quotes.
UNWRAPPED_LINE = re.compile(r"^\s*(\||\[.*\]: |<)|^ {4}|https?://|^\S+$")


def tracked(folders):
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", *folders],
        check=True, capture_output=True, text=True).stdout.split("\n")
    return [Path(path) for path in listed if path and Path(path).is_file()]


def sizes(paths):
    for path in paths:
        script = path.suffix in WRAPPED or path.as_posix() == ".ci/run"
        if not script and path.suffix != ".md":
            continue
        lines = path.read_text(encoding="utf-8").split("\n")
        if path.suffix in (".rs", ".py") and len(lines) - 1 > LINES:
            yield f"{path}: {len(lines) - 1} lines, at most {LINES}"
        quoted = False
        for number, line in enumerate(lines, 1):
            quoted ^= path.suffix == ".md" and line.startswith("```")
            whole = quoted or (path.suffix == ".md" and UNWRAPPED_LINE.search(line))
            if len(line) > COLUMNS and not whole:
                yield f"{path}:{number}: {len(line)} columns, at most {COLUMNS}"


# --- circles

COMMENTS = re.compile(r"//[^\n]*|/\*.*?\*/", re.S)
TESTS = re.compile(r"#\[cfg\(test\)\]\s*(?:#\[[^\n]*\]\s*)*mod \w+ \{.*", re.S)
USE = re.compile(r"^\s*(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);", re.M)
INLINE = re.compile(r"(?<![\w:])((?:crate|super|self)(?:::\w+)+)")


def modules(source):
    """Module path -> file, of one crate, from the names of the files."""
    found = {}
    for path in sorted(source.rglob("*.rs")):
        parts = list(path.relative_to(source).with_suffix("").parts)
        if parts[0] == "bin" or parts[-1] == "tests":
            continue
        if parts[-1] in ("mod", "lib", "main"):
            parts.pop()
        found[tuple(parts)] = path
    return found


def leaves(tree):
    """`a::{b, c::{d, e}}` -> the paths in it, without `as` names."""
    tree = tree.strip()
    opened = tree.find("{")
    if opened < 0:
        return [[part.strip() for part in tree.split(" as ")[0].split("::") if part.strip()]]
    head = [part.strip() for part in tree[:opened].split("::") if part.strip()]
    inner, depth, begun, parts = tree[opened + 1:tree.rindex("}")], 0, 0, []
    for at, char in enumerate(inner + ","):
        depth += (char == "{") - (char == "}")
        if char == "," and depth == 0:
            parts.append(inner[begun:at])
            begun = at + 1
    return [head + leaf for part in parts if part.strip() for leaf in leaves(part)]


def absolute(path, module, files):
    """A path as written in `module`, from the crate's root; None for other crates' names."""
    if path[0] == "crate":
        return path[1:]
    base, rest = list(module), list(path)
    if rest[0] not in ("self", "super"):
        return base + rest if tuple(base + rest[:1]) in files else None
    while rest and rest[0] in ("self", "super"):
        if rest.pop(0) == "super":
            base = base[:-1]
    return base + rest


def read(source):
    files, exports, uses = modules(source), {}, {}
    for module, path in files.items():
        text = TESTS.sub("", COMMENTS.sub("", path.read_text(encoding="utf-8")))
        uses[module] = []
        for public, tree in USE.findall(text):
            for leaf in leaves(tree):
                full = absolute(leaf, module, files)
                if full is None:
                    continue
                if public:
                    exports[(module, leaf[-1])] = full
                else:
                    uses[module].append(full)
        for written in INLINE.findall(USE.sub("", text)):
            uses[module].append(absolute(written.split("::"), module, files))
    return files, exports, uses


def owner(full, files, exports, depth=0):
    """The module that defines a name."""
    for cut in range(len(full), -1, -1):
        module = tuple(full[:cut])
        if module not in files:
            continue
        handed_on = exports.get((module, full[cut])) if cut < len(full) else None
        if handed_on and depth < 8:
            return owner(handed_on + list(full[cut + 1:]), files, exports, depth + 1)
        return module
    return None


def circles(source):
    files, exports, uses = read(source)
    arrows = {module: {} for module in files}
    for module, paths in uses.items():
        for full in paths:
            target = owner(full, files, exports)
            # A bare `use super::child` names a module, not what is in it.
            if target is not None and target != module and tuple(full) != target:
                arrows[module].setdefault(target, set()).add(full[-1])
            elif target is not None and target != module:
                arrows[module].setdefault(target, set()).add("(module)")

    def reached(start):
        seen, todo = set(), list(arrows[start])
        while todo:
            at = todo.pop()
            if at not in seen:
                seen.add(at)
                todo += arrows[at]
        return seen

    reach = {module: reached(module) for module in files}
    told = set()
    for module in files:
        circle = {other for other in reach[module] if module in reach[other]} | {module}
        if len(circle) == 1 or module in told:
            continue
        told |= circle
        names = ", ".join(sorted(files[one].as_posix() for one in circle))
        yield f"circle of {len(circle)} files: {names}"
        for one in sorted(circle):
            for other in sorted(arrows[one]):
                if other in circle:
                    taken = ", ".join(sorted(arrows[one][other]))
                    yield f"    {files[one]} -> {files[other]}: {taken}"


def main():
    paths = tracked(sys.argv[1:])
    problems = list(sizes(paths))
    sources = sorted({Path(*path.parts[:path.parts.index("src") + 1])
                      for path in paths if path.suffix == ".rs" and "src" in path.parts})
    sources += [root for root in (Path("tools/farreach"),) if any(root in p.parents for p in paths)]
    for source in sources:
        problems += circles(source)
    print("\n".join(problems))
    sys.exit(1 if problems else 0)


main()

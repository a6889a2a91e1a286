"""Checks the links between the project's Markdown files: that the file and the heading exist.

Links to the web are not followed.

    links.py [ROOT]
"""

import re
import subprocess
import sys
from pathlib import Path

LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def text_of(path):
    """Without code, in which brackets mean something else."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```", "", text, flags=re.M | re.S)
    text = re.sub(r"^(?: {4}|\t).*$", "", text, flags=re.M)
    return re.sub(r"`[^`\n]*`", lambda code: "x" * len(code.group()), text)


def anchors(path):
    headings = re.findall(r"^#+ +(.*)$", path.read_text(encoding="utf-8"), flags=re.M)
    words = (re.sub(r"[^\w\- ]", "", heading.strip().lower()) for heading in headings)
    return {word.replace(" ", "-") for word in words}


def main():
    root = Path(sys.argv[1] if len(sys.argv) > 1 else ".").resolve()
    listed = subprocess.run(
        ["git", "ls-files", "-z", "*.md"], cwd=root, check=True, capture_output=True, text=True)
    # The generated pages in docs are checked; the texts they are made from bear links for there.
    files = [root / name for name in listed.stdout.split("\0")
             if name and not name.startswith("launch/rig/src/tests/generated_pages/")]
    broken, links = [], 0
    for file in files:
        for link in LINK.findall(text_of(file)):
            if re.match(r"[a-z]+:", link):
                continue
            links += 1
            name, _, anchor = link.partition("#")
            target = (file.parent / name) if name else file
            if not target.exists():
                broken.append(f"{file.relative_to(root)}: {link}: no such file")
            elif anchor and target.suffix == ".md" and anchor not in anchors(target):
                broken.append(f"{file.relative_to(root)}: {link}: no such heading")
    for line in broken:
        print(line, file=sys.stderr)
    print(f"{links} links in {len(files)} files, {len(broken)} broken")
    return 1 if broken or not files else 0


if __name__ == "__main__":
    sys.exit(main())

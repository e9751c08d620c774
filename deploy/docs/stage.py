#!/usr/bin/env python3
"""Copies all documents, and the files that they link to, into an empty folder, each at its place in the tree.

stage.py SOURCE_DIR FOLDER
"""
import os
import pathlib
import re
import shutil
import sys

MADE = {"build", "demo-out", "packages", "report", "site"}  # folders of the project's root that hold no sources


def copy(source, file, folder):
    to = folder / file.relative_to(source)
    if not to.exists():
        to.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, to)
    return to


def for_mkdocs(text):
    """What MkDocs' Markdown reads otherwise than GitHub's: it wants a blank line before a table or a list, and in a table it keeps
    the backslash of an escaped bar in a code span."""
    lines, fenced, last = [], False, ""
    for line in text.splitlines():
        fenced ^= line.lstrip().startswith("```")
        begins = re.match(r"\||- |\d+\. ", line)
        if not fenced and begins and last and not re.match(r"\||- |\d+\. |\s", last):
            lines.append("")
        lines.append(line)
        last = line
    return re.sub(r"`[^`\n]+`", lambda span: span[0].replace(r"\|", "|"), "\n".join(lines) + "\n")


def main(source, folder):
    for at, folders, files in os.walk(source):
        folders[:] = sorted(f for f in folders if f not in (".git", "__pycache__")
                            and not (at == str(source) and f in MADE) and (pathlib.Path(at) / f).resolve() != folder)
        for name in sorted(f for f in files if f.endswith(".md")):
            document = pathlib.Path(at) / name
            text = document.read_text()
            for link in re.findall(r"\]\(([^()\s#]+)[^()\s]*\)", text):
                target = (document.parent / link).resolve()
                if target.is_file() and target.suffix != ".md" and source in target.parents:
                    copy(source, target, folder)
            copy(source, document, folder).write_text(for_mkdocs(text))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*(pathlib.Path(p).resolve() for p in sys.argv[1:]))

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
            # MkDocs' tables keep a bar within a code span as it is, GitHub's want it escaped.
            to = copy(source, document, folder)
            to.write_text(re.sub(r"`[^`\n]+`", lambda span: span[0].replace(r"\|", "|"), text))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*(pathlib.Path(p).resolve() for p in sys.argv[1:]))

#!/usr/bin/env python3
"""The documents against what they speak of: links and anchors, files and functions, tests, commands and their flags.

documents_test.py SOURCE_DIR BUILD_DIR
"""
import errno
import functools
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import unittest

SOURCE, BUILD = (pathlib.Path(p).resolve() for p in sys.argv[1:3])
PROGRAMS = ("telenano-nve", "telenano-master", "telenano-lab", "telenano-afm-sim")
MADE = {"build", "demo-out", "packages", "report", "site"}  # folders of the project's root that hold no sources
README_BYTES = 8192
FOREIGN = {"apt", "buildah", "cmake", "ctest", "cyclictest", "debootstrap", "systemctl", "--build-arg"}  # whose flags are not ours


def documents():
    for folder, folders, files in os.walk(SOURCE):
        folders[:] = sorted(f for f in folders if f not in (".git", "__pycache__") and not (folder == str(SOURCE) and f in MADE))
        yield from (pathlib.Path(folder) / f for f in sorted(files) if f.endswith(".md"))


def name(path):
    return str(path.relative_to(SOURCE))


def without_code(text):
    """The text without fenced and indented blocks and code spans, whose brackets are no links."""
    text = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.M | re.S)
    text = re.sub(r"\n\n((?:    .*\n)+)", "\n\n", text)
    return re.sub(r"`[^`]*`", "", text)


def links(path):
    return re.findall(r"\]\(([^()\s]+)\)", without_code(path.read_text()))


def anchors(path):
    """The anchors that GitHub gives to the headings: small letters, spaces to dashes, no punctuation; -1, -2 for repeats."""
    seen, found = {}, set()
    text = re.sub(r"^ *```.*?^ *```$", "", path.read_text(), flags=re.M | re.S)
    for heading in re.findall(r"^#+ +(.*?) *#*$", text, flags=re.M):
        heading = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading)
        slug = re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")
        again = seen.get(slug, 0)
        seen[slug] = again + 1
        found.add(slug if again == 0 else f"{slug}-{again}")
    return found


def broken_links(path):
    broken = []
    for link in links(path):
        if re.match(r"[a-z]+:", link):
            continue
        file, _, anchor = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        if not target.exists():
            broken.append(f"{link}: there is no such file")
        elif anchor and target.suffix == ".md" and anchor not in anchors(target):
            broken.append(f"{link}: there is no such heading")
    return broken


def code(text):
    """Fenced and indented blocks and code spans, as single lines: what a reader would type."""
    blocks = re.findall(r"^ *```(?:sh)?\n(.*?)^ *```$", text, flags=re.M | re.S)
    text = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.M | re.S)
    blocks += re.findall(r"\n\n((?: {4,}.*\n)+)", text)
    lines = [line.strip() for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    spans = [re.sub(r"\s+", " ", span).replace(r"\|", "|") for span in re.findall(r"`([^`]+)`", text)]
    return lines + spans


@functools.cache
def help_of(*command):
    done = subprocess.run([BUILD / "bin" / command[0], *command[1:], "--help"], capture_output=True, text=True, timeout=60)
    return done.stdout if done.returncode == 0 else ""


@functools.cache
def subcommands(*command):
    listed = re.search(r"^Subcommands:\n((?:  .*\n?)+)", help_of(*command), flags=re.M)
    return set(re.findall(r"^  ([a-z][\w-]*)", listed[1], flags=re.M)) if listed else set()


def words_of(command):
    try:
        return shlex.split(command, comments=True)
    except ValueError:
        return command.split()


def wrong_command(command):
    """What of a program's command does not exist: a subcommand, a flag; None if all does."""
    words = words_of(command)
    if not words or words[0] not in PROGRAMS:
        return None
    at, rest = [words[0]], words[1:]
    while rest and subcommands(*at) and re.fullmatch(r"[a-z][a-z-]*", rest[0]):
        if rest[0] not in subcommands(*at):
            return f"'{command}': {' '.join(at)} has no {rest[0]}"
        at.append(rest.pop(0))
    known = set(re.findall(r"--[a-z][\w-]*", help_of(*at)))
    for word in rest:
        if word in ("|", "||", "&&", ";", ">", "…", "..."):  # another command, or all that may follow
            break
        flag = re.match(r"--[a-z][\w-]*", word)
        if flag and flag[0] not in known:
            return f"'{command}': {' '.join(at)} has no {flag[0]}"
    return None


@functools.cache
def ctest(*arguments):
    # From a folder of its own: even to list, CTest begins its log anew, and that of the run that this is part of would be lost.
    with tempfile.TemporaryDirectory() as folder:
        (pathlib.Path(folder) / "CTestTestfile.cmake").write_text(f'subdirs("{BUILD}")\n')
        listed = subprocess.run(["ctest", "-C", "full", "-N", *arguments], cwd=folder, capture_output=True, text=True, timeout=120).stdout
    return re.findall(r"^ *Test +#\d+: (\S+)", listed, flags=re.M)


def without_comments(file):
    """A source's code: a name that only a comment still has leads nowhere."""
    text = file.read_text()
    if file.suffix == ".toml":
        return re.sub(r"#.*", "", text)
    return re.sub(r"/\*.*?\*/|//[^\n]*", "", text, flags=re.S) if file.suffix in (".h", ".cpp", ".proto") else text


def said_by_the_programs():
    """What stands in the sources' texts; a text that is broken over lines in one piece."""
    texts = []
    for folder in ("common", "master", "nve_server"):
        for path in (SOURCE / folder).rglob("*.[ch]*"):
            code = without_comments(path) if path.suffix in (".h", ".cpp") else ""
            texts += ["".join(re.findall(r'"((?:\\.|[^"\\\n])*)"', t)) for t in re.findall(r'(?:"(?:\\.|[^"\\\n])*"\s*)+', code)]
    return "\n".join(texts) + "\n" + "\n".join(map(os.strerror, errno.errorcode))


def wrong_places(path):
    """Links to a file of the project with names in code spans behind them: how many, and what is not there."""
    places, wrong = 0, []
    text = path.read_text()
    for place in re.finditer(r"\]\((?!\w+:)([^()\s#]+\.(?:h|cpp|toml|proto))\)((?:\s+`[^`]+`)*)", text):
        link, functions = place.groups()
        in_table = text[text.rfind("\n", 0, place.start()) + 1] == "|"
        file = (path.parent / link).resolve()
        if not file.is_file():
            wrong.append(f"{name(path)}: there is no {link}")
        elif functions:
            places += 1
            wrong += [f"{name(path)}: {f} is not in {link}" for f in re.findall(r"`([^`]+)`", functions)
                      if not re.search(rf"\b{re.escape(f)}\b", without_comments(file))]
        elif in_table:
            wrong.append(f"{name(path)}: {link} without a function")
    return places, wrong


def numbers(text):
    """'eqs. 14–17' as {('eq', '14'), ...}; 'figs. 4a-d' as a to d of 4."""
    found = set()
    for kind, listed in re.findall(r"\b(eq|fig)s?\.\s+((?:\d+[a-d]?(?:\s*[–-]\s*(?:\d+|[a-d]))?(?:,\s|\sand\s)?)+)", text):
        for first, letter, last in re.findall(r"(\d+)([a-d]?)(?:\s*[–-]\s*(\d+|[a-d]))?", listed):
            if letter:
                found |= {(kind, first + chr(c)) for c in range(ord(letter), ord(last or letter) + 1)}
            else:
                found |= {(kind, str(n)) for n in range(int(first), int(last or first) + 1)}
    return found


def named_in_code():
    """(paper, kind, number) of every equation and figure of KS and CB that a source names."""
    found = {}
    papers = {"KS": r"KS|Kim & Sitti", "CB": r"CB|Colgate & Brown"}
    for folder in ("common", "master", "nve_server", "tests", "deploy"):
        for path in (SOURCE / folder).rglob("*"):
            if path.suffix not in (".h", ".cpp", ".sh", ".toml", ".py") or path.name == "documents_test.py":
                continue
            text = re.sub(r"\n\s*(///|//|#|\")?\s*", " ", path.read_text(errors="replace"))
            for paper, pattern in papers.items():
                for window in re.findall(rf"\b(?:{pattern})\b([^\]:;]{{0,40}})", text):
                    found.update({(paper, *what): name(path) for what in numbers(window)})
    return found


class Documents(unittest.TestCase):
    def none(self, wrong):
        if wrong:
            self.fail("\n" + "\n".join(wrong))

    def needs_all_parts(self):
        cache = (BUILD / "CMakeCache.txt").read_text()
        if re.search(r"^TELENANO_(DTLS|HID|METRICS|SYSTEMD|VIEWER):BOOL=OFF$", cache, flags=re.M):
            self.skipTest("a build without all parts has not all tests, commands and flags")

    def test_readme_is_short(self):
        self.assertLessEqual((SOURCE / "README.md").stat().st_size, README_BYTES)

    def test_no_page_is_mostly_one_table(self):
        for path in [SOURCE / "README.md", *(SOURCE / "deploy/docs").glob("*.md")]:
            text = path.read_text()
            largest = max((len(t) for t in re.findall(r"(?:^\|.*\n)+", text, flags=re.M)), default=0)
            self.assertLessEqual(largest, 0.41 * len(text), name(path))

    def test_links_and_anchors(self):
        self.none([f"{name(path)}: {link}" for path in documents() for link in broken_links(path)])

    def test_each_document_is_in_the_table_of_contents(self):
        folder = SOURCE / "deploy/docs"
        named = {(folder / link.partition("#")[0]).resolve() for link in links(folder / "README.md")}
        self.none([name(p) for p in folder.glob("*.md") if p.name != "README.md" and p.resolve() not in named])

    def test_files_and_functions_of_the_indexes_exist(self):
        for page, least in (("equations.md", 70), ("glossary.md", 60), ("change-the-code.md", 25)):
            places, wrong = wrong_places(SOURCE / "deploy/docs" / page)
            self.none(wrong)
            self.assertGreater(places, least, page)

    def test_the_index_has_what_the_code_names(self):
        rows = [line.split("|")[1] for line in (SOURCE / "deploy/docs/equations.md").read_text().splitlines() if line.startswith("| ")]
        index = {(row.split()[0], *what) for row in rows if row.split() for what in numbers(row)}
        code = named_in_code()
        self.assertGreater(len(code), 20)
        self.none([f"{paper} {kind}. {number} of {where} is not in deploy/docs/equations.md"
                   for (paper, kind, number), where in sorted(code.items()) if (paper, kind, number) not in index])

    def test_what_a_newcomer_looks_up_leads_to_code(self):
        """Each equation and figure of KS and CB that the index has: a row, and in it a function that is there."""
        page = SOURCE / "deploy/docs/equations.md"
        rows = [line for line in page.read_text().splitlines() if re.match(r"\| (KS|CB|heavy)\b", line)]
        answered = set()
        for row in rows:
            first = row.split("|")[1]
            places = re.findall(r"\]\(([^()\s]+\.(?:h|cpp|toml))\)((?:\s+`[^`]+`)+)", row)
            self.assertTrue(places, f"{first.strip()}: no file with a function")
            answered |= {(first.split()[0].removesuffix("'s"), *what) for what in numbers(first)}
        for paper, kind, wanted in (("KS", "eq", ["7", "9", "10", *map(str, range(14, 23))]),
                                    ("KS", "fig", ["6", *map(str, range(10, 19))]), ("CB", "fig", ["3", "4a", "4b", "4c", "4d"])):
            self.none([f"{paper} {kind}. {n} is not in the index" for n in wanted if (paper, kind, n) not in answered])

    def test_what_draws_a_figure_is_what_the_program_calls(self):
        """A figure's function in the index is one that telenano-lab can draw: named where the figures are listed."""
        studies = SOURCE / "tests/studies"
        listed = "".join(without_comments(path) for path in studies.rglob("*.cpp"))
        index = (SOURCE / "deploy/docs/equations.md").read_text()
        drawn = set(re.findall(r"`(draw_(?:ks|cb)\d+)`", index))
        self.assertGreaterEqual(len(drawn), 8)
        self.none([f"nobody draws by {f}" for f in drawn if not re.search(rf"(?<!Figure )\b{f}\b", listed)])

    def test_tests_that_are_named_exist(self):
        self.needs_all_parts()
        names = ctest()
        if any(test.endswith("_NOT_BUILT") for test in names):
            self.skipTest("not all test programs are built")
        wrong, found = [], 0
        for path in documents():
            for command in code(path.read_text()):
                words = words_of(command)
                if not words or words[0] != "ctest":
                    continue
                for flag, pattern in zip(words, words[1:]):
                    if flag == "-R" and not re.fullmatch("[A-Z]+", pattern):  # PATTERN, NAME: any
                        found += 1
                        if not any(re.search(pattern, test) for test in names):
                            wrong.append(f"{name(path)}: no test matches '{pattern}'")
                    if flag == "-L" and not ctest("-L", pattern):
                        wrong.append(f"{name(path)}: no test has the label '{pattern}'")
        self.none(wrong)
        self.assertGreater(found, 30)

    def test_what_is_started_first_exists(self):
        self.needs_all_parts()
        names = set(ctest())
        if any(test.endswith("_NOT_BUILT") for test in names):
            self.skipTest("not all test programs are built")
        costly = re.findall(r'^set_tests_properties\("(.*?)"', (SOURCE / "tests/costs/costs.cmake").read_text(), flags=re.M)
        self.assertGreater(len(costly), 50)
        self.none([f"tests/costs/costs.cmake: there is no test {test}" for test in costly if test not in names])

    def test_commands_and_flags_exist(self):
        self.needs_all_parts()
        commands = [(path, command) for path in documents() for command in code(path.read_text())]
        wrong = [(path, wrong_command(command)) for path, command in commands]
        self.none([f"{name(path)}: {what}" for path, what in wrong if what])
        self.assertGreater(sum(command.startswith("telenano-") for _, command in commands), 100)

    def test_each_subcommand_has_an_example(self):
        text = (SOURCE / "deploy/docs/programs.md").read_text()
        self.none([f"deploy/docs/programs.md has no {program} {sub}" for program in PROGRAMS for sub in sorted(subcommands(program))
                   if not re.search(rf"\b{program} {sub}\b", text)])

    def test_flags_without_their_program_exist(self):
        self.needs_all_parts()
        known = set()
        for path in [*(SOURCE / "deploy").rglob("*.sh"), *(SOURCE / "tests").rglob("*.sh")]:
            known |= set(re.findall(r"--[a-z][\w-]*", path.read_text()))
        commands = [(program,) for program in PROGRAMS]
        while commands:
            command = commands.pop()
            known |= set(re.findall(r"--[a-z][\w-]*", help_of(*command)))
            commands += [(*command, sub) for sub in subcommands(*command)]
        wrong, found = [], 0
        for path in documents():
            for span in code(path.read_text()):
                if re.match(r"(?:[a-z]+ )*--[a-z]", span) and span.split()[0] not in FOREIGN:
                    found += 1
                    wrong += [f"{name(path)}: '{span}': nothing has {flag}"
                              for flag in re.findall(r"(?<![\w-])--[a-z][\w-]*", span) if flag not in known]
        self.none(wrong)
        self.assertGreater(found, 60)

    def test_scripts_that_are_named_exist(self):
        wrong = []
        for path in documents():
            for command in code(path.read_text()):
                for script in re.findall(r"(?<![\w/.])((?:deploy|tests)/[\w/]+\.(?:sh|py))", command):
                    if not (SOURCE / script).exists():
                        wrong.append(f"{name(path)}: there is no {script}")
        self.none(wrong)

    def test_site_script_refuses_in_one_line(self):
        script = SOURCE / "deploy/docs/build.sh"
        with tempfile.TemporaryDirectory() as folder:
            for needed in ("dirname", "nproc", "realpath"):  # and no mkdocs
                os.symlink(shutil.which(needed), pathlib.Path(folder) / needed)
            for arguments, said in ((["--otu", "x"], "there is no option --otu"), (["--out"], "--out needs a folder"),
                                    ([], "mkdocs is missing: apt-get install mkdocs")):
                run = subprocess.run([shutil.which("bash"), script, *arguments], env={"PATH": folder}, capture_output=True, text=True)
                self.assertEqual(run.returncode, 2, run.stderr)
                self.assertEqual(run.stderr.count("\n"), 1, run.stderr)
                self.assertIn(said, run.stderr)
                self.assertEqual(run.stdout, "")

    def test_site_has_every_document_and_what_it_links_to(self):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, "-B", SOURCE / "deploy/docs/stage.py", SOURCE, folder], check=True)
            staged = pathlib.Path(folder)
            for path in documents():
                at = staged / path.relative_to(SOURCE)
                self.assertTrue(at.exists(), name(path))
                for link in links(path):
                    file = link.partition("#")[0]
                    if file and not re.match(r"[a-z]+:", link):
                        self.assertTrue((at.parent / file).exists(), f"{name(path)}: {link}")
            for page in re.findall(r": (\S+\.md)$", (SOURCE / "deploy/docs/mkdocs.yml").read_text(), flags=re.M):
                self.assertTrue((staged / page).exists(), page)

    def test_each_symptom_is_said_by_a_program(self):
        """What OPERATIONS.md says that a person sees; HOST:PORT and … stand for anything."""
        table = (SOURCE / "deploy/OPERATIONS.md").read_text().partition("## What to do when")[2].partition("\n## ")[0]
        said = said_by_the_programs()
        seen = [text for row in re.findall(r"^\| ([^|]*)\|", table, flags=re.M) for text in re.findall(r"`([^`]+)`", row)]
        self.assertGreater(len(seen), 12)
        self.none([f"no program says '{text}'" for text in seen
                   if not all(part.strip(": ") in said for part in re.split("…|HOST:PORT|keys.toml", text))])

    def test_each_hazard_names_a_test_that_exists(self):
        """In the first table of SAFETY.md; … stands for what is left out."""
        rows = re.findall(r"^\|(.*)\|$", (SOURCE / "nve_server/afm/SAFETY.md").read_text().partition("## Known")[0], flags=re.M)[2:]
        self.assertGreater(len(rows), 20)
        scripts = "".join(path.read_text() for path in (SOURCE / "tests/system").glob("*.py"))
        tests = " ".join(ctest()) + " " + " ".join(re.findall(r"def (test_\w+)", scripts))
        wrong = []
        for row in rows:
            named = re.findall(r"`([^`]+)`", row.split("|")[-1])
            wrong += [f"{row.split('|')[0].strip()}: there is no {n}" for n in named
                      if not n.endswith(".py") and n.strip("…") not in tests]
            if not named:
                wrong.append(f"{row.split('|')[0].strip()}: shown by no test")
        self.none(wrong)

    def test_what_runs_here_finds_mistakes(self):
        self.needs_all_parts()
        self.assertEqual(anchors(SOURCE / "deploy/OPERATIONS.md") & {"an-afm", "no-such"}, {"an-afm"})
        self.assertIn("has no sevre", wrong_command("telenano-nve sevre --scene flakes"))
        self.assertIn("has no --scnee", wrong_command("telenano-nve serve --scnee flakes"))
        self.assertIn("has no nett", wrong_command("telenano-lab bench nett"))
        self.assertIsNone(wrong_command("telenano-nve keys new omega-1 --rights operate   # --comment"))
        self.assertEqual(numbers("eqs. 14–17"), {("eq", n) for n in ("14", "15", "16", "17")})
        self.assertEqual(numbers("figs. 4a-d and fig. 3"), {("fig", n) for n in ("4a", "4b", "4c", "4d", "3")})
        self.assertEqual(numbers(", eqs. 21, 22, fig. 12"), {("eq", "21"), ("eq", "22"), ("fig", "12")})
        self.assertIsNone(wrong_command("telenano-nve serve | telenano-master run --observe"))
        with tempfile.TemporaryDirectory() as folder:
            source = pathlib.Path(folder) / "source.h"
            source.write_text("/* gone_1() */ int here();  // gone_2()\n/// gone_3()\n")
            self.assertEqual(re.findall(r"\w+(?=\()", without_comments(source)), ["here"])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])

"""Runs the cases of a unittest file side by side, each in a process of its own: for cases that mostly wait."""
import concurrent.futures
import subprocess
import sys
import time
import unittest


def case_names(suite):
    for part in suite:
        if isinstance(part, unittest.TestSuite):
            yield from case_names(part)
        else:
            yield ".".join(part.id().split(".")[-2:])


def main(fixed_words, at_once):
    """As unittest.main, where `fixed_words` are the words before unittest's own. Returns the exit status.

    With words of unittest's own (a case, a flag) it is unittest.main in this process.
    """
    program = sys.argv[:1 + fixed_words]
    own = sys.argv[1 + fixed_words:]
    if own:
        return 0 if unittest.main(argv=program[:1] + own, warnings="ignore", exit=False).result.wasSuccessful() else 1
    names = list(case_names(unittest.defaultTestLoader.loadTestsFromModule(sys.modules["__main__"])))

    def run(name):
        start = time.monotonic()
        done = subprocess.run([sys.executable, "-B", *program, name], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                              check=False)
        return name, done.returncode, done.stdout, time.monotonic() - start

    red = 0
    with concurrent.futures.ThreadPoolExecutor(at_once) as pool:
        for name, status, text, took_s in pool.map(run, names):
            print(f"{name}: {'ok' if status == 0 else 'FAILED'}, {took_s:.1f} s")
            if status != 0 or "skipped" in text or "again:" in text:
                print(text)
            red += status != 0
    print(f"{len(names)} cases, {red} failed")
    return 1 if red or not names else 0

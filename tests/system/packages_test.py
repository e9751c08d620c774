#!/usr/bin/env python3
"""The Debian packages, unpacked into an empty folder: what is in them, that the programs run from any folder and find their
scenes, that maintainer scripts and the unit are well formed.

packages_test.py BUILD_DIR
"""
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

BUILD = pathlib.Path(sys.argv[1])
PROGRAMS = {"server": "telenano-nve", "station": "telenano-master", "lab": "telenano-lab"}


def run(*words, **options):
    return subprocess.run([str(w) for w in words], capture_output=True, text=True, timeout=120, **options)


class Packages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="telenano_packages_"))
        # Everything is built already; the target that CPack would build first is the whole tree.
        made = run("cpack", "-G", "DEB", "-B", cls.folder / "out", "-D", "CPACK_CMAKE_GENERATOR=Ninja",
                   "--config", BUILD / "CPackConfig.cmake", cwd=BUILD)
        assert made.returncode == 0, made.stdout + made.stderr
        cls.packages = {p.name.split("_")[0].removeprefix("telenano-"): p for p in (cls.folder / "out").glob("*.deb")}
        cls.root = cls.folder / "root"
        for package in cls.packages.values():
            subprocess.run(["dpkg-deb", "-x", package, cls.root], check=True)

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.folder)

    def field(self, component, name):
        return run("dpkg-deb", "-f", self.packages[component], name).stdout.strip()

    def test_one_package_a_role(self):
        self.assertEqual(set(self.packages), {"common", "server", "station", "lab", "dev"})
        for component, package in self.packages.items():
            names = run("dpkg-deb", "-c", package).stdout
            self.assertIn(f"usr/share/doc/telenano-{component}/copyright", names)
            self.assertNotRegex(names, r"\./(usr/local|home|root|tmp|var)/")
            if component in PROGRAMS:
                self.assertIn(f"usr/share/bash-completion/completions/{PROGRAMS[component]}\n", names)
            for other, program in PROGRAMS.items():
                (self.assertIn if other == component else self.assertNotIn)(f"usr/bin/{program}\n", names)

    def test_documents_come_along(self):
        documents = self.root / "usr/share/doc/telenano-common"
        for name in ("OPERATIONS.md", "CHANGELOG.md", "docs/README.md", "docs/evidence.md", "docs/equations.md"):
            self.assertTrue((documents / name).is_file(), name)

    def test_the_deadman_is_ready_to_be_copied(self):
        folder = self.root / "usr/share/telenano/afm"
        self.assertTrue((folder / "deadman.toml").is_file())
        self.assertIn("new-key", run(folder / "deadman.py", "--help").stdout)

    def test_libraries_come_with_headers_and_examples(self):
        self.assertTrue((self.root / "usr/include/telenano/master/station/station.h").is_file())
        self.assertTrue((self.root / "usr/lib/telenano/libtelenano_station.a").is_file())
        self.assertTrue((self.root / "usr/lib/cmake/telenano/telenanoConfig.cmake").is_file())
        self.assertTrue((self.root / "usr/share/doc/telenano-dev/examples/03_station.cpp").is_file())

    def test_no_file_is_in_two(self):
        files = []
        for package in self.packages.values():
            files += [line.split()[5] for line in run("dpkg-deb", "-c", package).stdout.splitlines() if not line.startswith("d")]
        self.assertEqual(len(files), len(set(files)))

    def test_dependencies(self):
        version = self.field("common", "Version")
        for component in ("server", "lab"):
            self.assertIn(f"telenano-common (= {version})", self.field(component, "Depends"))
        self.assertNotIn("telenano-common", self.field("station", "Depends"))
        self.assertIn("libhdf5", self.field("station", "Depends"))
        self.assertNotIn("libhdf5", self.field("server", "Depends"))
        self.assertEqual(self.field("common", "Architecture"), "all")

    def test_runs_from_any_folder(self):
        with tempfile.TemporaryDirectory() as anywhere:
            for program in PROGRAMS.values():
                self.assertEqual(run(self.root / "usr/bin" / program, "--version", cwd=anywhere).returncode, 0)
            nve = self.root / "usr/bin/telenano-nve"
            check = run(nve, "check", "--scene", "flakes", cwd=anywhere)
            self.assertEqual(check.returncode, 0, check.stderr)
            missing = run(nve, "check", "--scene", "flak", cwd=anywhere)
            self.assertEqual(missing.returncode, 2)
            self.assertRegex(missing.stderr, "has only: flakes, flakes_potential, flat_pdms")
            for scene in (self.root / "usr/share/telenano/scenes").glob("*.toml"):
                self.assertEqual(run(nve, "check", "--scene", scene.stem, cwd=anywhere).returncode, 0, scene)

    def test_serves_what_its_own_unit_says(self):
        arguments = re.search("^TELENANO_SERVE=(.*)$", (self.root / "etc/telenano/nve.env").read_text(), re.M)[1]
        words = re.sub(r"--listen \S+", "--listen 127.0.0.1:0", arguments).split()
        server = subprocess.Popen([self.root / "usr/bin/telenano-nve", "serve", *words], cwd="/", stderr=subprocess.PIPE, text=True)
        self.assertIn("serving flakes", server.stderr.readline())
        server.send_signal(signal.SIGTERM)
        self.assertIn("stopped", server.stderr.read())
        self.assertEqual(server.wait(), 0)

    def test_scripts_and_conffiles(self):
        for component in ("server", "station"):
            control = self.folder / f"control-{component}"
            subprocess.run(["dpkg-deb", "-e", self.packages[component], control], check=True)
            for name in ("postinst", "prerm", "postrm"):
                script = control / name
                if script.exists():
                    self.assertTrue(os.access(script, os.X_OK))
                    self.assertEqual(run("sh", "-n", script).returncode, 0)
            for path in (control / "conffiles").read_text().split():
                self.assertTrue((self.root / path.lstrip("/")).exists(), path)
        self.assertEqual((self.root / "usr/bin/telenano-nve").stat().st_mode & 0o7777, 0o755)  # no setuid

    def test_programs_are_hardened_and_run_on_any_x86_64(self):
        # As the loader and the kernel see them: what hardening-check of Debian's devscripts looks at, and a little more.
        cache = (BUILD / "CMakeCache.txt").read_text()
        if not re.search("^CMAKE_BUILD_TYPE:[A-Z]+=Release$", cache, re.M) or "TELENANO_HARDENING:BOOL=OFF" in cache:
            self.skipTest("not a release build, or one without TELENANO_HARDENING")
        for program in (self.root / "usr/bin").iterdir():
            with self.subTest(program=program.name):
                header = run("readelf", "-hW", program).stdout
                segments = run("readelf", "-lW", program).stdout
                dynamic = run("readelf", "-dW", program).stdout
                # Stripped programs keep the names of what they take from libraries.
                names = set(re.findall(r"UND (\w+)@", run("readelf", "--dyn-syms", "-W", program).stdout))
                self.assertRegex(header, r"Type:\s+DYN \(Position-Independent Executable", "PIE")
                self.assertRegex(segments, r"GNU_RELRO")
                self.assertRegex(segments, r"GNU_STACK\s+(0x0+ ){3}0x0+ 0x0+ RW ", "no code on the stack")
                self.assertRegex(dynamic, r"BIND_NOW|Flags: .*\bNOW\b")
                self.assertRegex(dynamic, r"Flags: .*\bPIE\b")
                self.assertNotRegex(dynamic, r"R(UN)?PATH")
                self.assertIn("__stack_chk_fail", names, "stack protector")
                self.assertTrue([n for n in names if re.fullmatch(r"__(?!stack)\w+_chk", n)], "_FORTIFY_SOURCE")
                # The same code before it was stripped: its symbols say where instructions begin behind a linker's padding.
                unstripped = BUILD / "bin" / program.name
                code = run("objdump", "-d", "-j", ".text", "--no-show-raw-insn", unstripped).stdout
                self.assertGreater(code.count("\tendbr64"), 300, "-fcf-protection marks where calls by pointer land")
                # AVX, AVX2, AVX-512, FMA: an older processor would end there, and results would differ. What is only
                # called where the processor has AVX, and gives the same bits, is in a section of its own.
                self.assertNotRegex(code, r"%[yz]mm\d|\tv(add|mul|sub|div|mov|fmadd)\w*[sp][sd]\b")

    @unittest.skipUnless(shutil.which("systemd-analyze"), "no systemd-analyze here")
    def test_unit_is_hardened(self):
        answer = run("systemd-analyze", "security", "--offline=true", f"--root={self.root}", "telenano-nve.service")
        exposure = re.search(r"exposure level[^:]*: ([0-9.]+)", answer.stdout)
        self.assertTrue(exposure, answer.stdout + answer.stderr)
        self.assertLess(float(exposure[1]), 2.0)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])

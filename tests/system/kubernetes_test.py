#!/usr/bin/env python3
"""The manifests for Kubernetes: they are YAML, name flags that there are, and agree with themselves. No cluster is asked.

kubernetes_test.py SOURCE TELENANO_NVE
"""
import pathlib
import subprocess
import sys
import unittest

try:
    import yaml
except ImportError:
    print("no python3-yaml here")
    sys.exit(77)

SOURCE, NVE = pathlib.Path(sys.argv.pop(1)), sys.argv.pop(1)


def documents():
    text = (SOURCE / "deploy/kubernetes/telenano-nve.yaml").read_text()
    return {document["kind"]: document for document in yaml.safe_load_all(text)}


class Kubernetes(unittest.TestCase):
    def setUp(self):
        self.deployment, self.service = documents()["Deployment"], documents()["Service"]
        self.pod = self.deployment["spec"]["template"]["spec"]
        self.server = self.pod["containers"][0]
        self.args = self.server["args"]

    def after(self, flag):
        return self.args[self.args.index(flag) + 1]

    def test_every_flag_is_one_of_the_program(self):
        self.assertEqual(self.server["command"], ["telenano-nve", "serve"])
        flags = subprocess.run([NVE, "serve", "--help"], capture_output=True, text=True, check=True).stdout.replace(",", " ").split()
        named = [word for word in self.args if word.startswith("--")]
        self.assertIn("--keys", named)
        for flag in named:
            self.assertIn(flag, flags)
        self.assertTrue(all(isinstance(word, str) for word in self.args))

    def test_there_is_one_server_and_its_end_has_its_time(self):
        self.assertEqual((self.deployment["spec"]["replicas"], self.deployment["spec"]["strategy"]["type"]), (1, "Recreate"))
        unit = (SOURCE / "deploy/systemd/telenano-nve.service").read_text()
        self.assertIn(f"TimeoutStopSec={self.pod['terminationGracePeriodSeconds']}\n", unit)

    def test_ports_and_probes_are_those_of_the_flags(self):
        ports = {port["name"]: port for port in self.server["ports"]}
        self.assertEqual(ports["sessions"]["containerPort"], int(self.after("--listen").rsplit(":", 1)[1]))
        self.assertEqual(ports["metrics"]["containerPort"], int(self.after("--metrics").rsplit(":", 1)[1]))
        probes = {name: self.server[name]["httpGet"] for name in ("startupProbe", "livenessProbe", "readinessProbe")}
        self.assertEqual({probe["port"] for probe in probes.values()}, {"metrics"})
        self.assertEqual([probe["path"] for probe in probes.values()], ["/healthz", "/healthz", "/readyz"])
        source = (SOURCE / "nve_server/app/serve/serve_health.cpp").read_text()
        for probe in probes.values():
            self.assertIn(f'"{probe["path"]}"', source)

    def test_the_service_finds_the_pods_by_udp(self):
        self.assertEqual(self.service["spec"]["selector"], self.deployment["spec"]["template"]["metadata"]["labels"])
        self.assertEqual(self.service["spec"]["selector"], self.deployment["spec"]["selector"]["matchLabels"])
        port = self.service["spec"]["ports"][0]
        self.assertEqual((port["protocol"], port["targetPort"]), ("UDP", "sessions"))

    def test_the_keys_are_copied_to_where_the_server_reads_them(self):
        copy = self.pod["initContainers"][0]
        self.assertEqual(copy["command"][:3], ["install", "-m", "600"])
        self.assertEqual(copy["command"][-1], self.after("--keys"))
        volumes = {volume["name"] for volume in self.pod["volumes"]}
        for container in (copy, self.server):
            self.assertLessEqual({mount["name"] for mount in container["volumeMounts"]}, volumes)


if __name__ == "__main__":
    unittest.main(verbosity=2)

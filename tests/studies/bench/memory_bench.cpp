#include "tests/studies/bench/memory_bench.h"

#include <signal.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>

#include "telenano/common/base/error.h"
#include "telenano/common/security/key_list.h"
#include "tests/support/child_process.h"
#include "tests/support/wire_station.h"

namespace telenano::studies {
namespace {

using support::ChildProcess;
using support::WireStation;

double resident_kib(pid_t pid) {
  std::ifstream statm("/proc/" + std::to_string(pid) + "/statm");
  double size = 0, resident = 0;
  if (!(statm >> size >> resident)) throw RunError("bench: the server has ended");
  return resident * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1024;
}

/// A folder that goes with the object.
struct Folder {
  Folder() {
    std::string name = (std::filesystem::temp_directory_path() / "telenano_bench_XXXXXX").string();
    if (::mkdtemp(name.data()) == nullptr) throw RunError("bench: cannot make " + name);
    path = name;
  }
  ~Folder() {
    std::error_code ignored;
    std::filesystem::remove_all(path, ignored);
  }
  Folder(const Folder&) = delete;
  Folder& operator=(const Folder&) = delete;
  std::filesystem::path path;
};

double kib_per_session(const MemoryBenchOptions& o, const std::string& scene, bool encrypted) {
  const Folder folder;
  std::vector<std::string> command{o.program,
                                   "serve",
                                   "--scene",
                                   scene,
                                   "--listen",
                                   "127.0.0.1:0",
                                   "--max-sessions",
                                   std::to_string(o.to),
                                   "--sessions-per-peer",
                                   std::to_string(o.to),
                                   "--timeout-ms",
                                   "60000"};
  std::optional<security::DtlsClientConfig> secure;
  if (encrypted) {
    const std::string keys = (folder.path / "keys.toml").string(), key = (folder.path / "one.key").string();
    const auto made = support::run_program({o.program, "keys", "new", "one", "--keys", keys, "--out", key});
    if (made.exit_code != 0) throw RunError("bench: " + made.err);
    secure.emplace();
    secure->key = security::load_station_key(key);
    command.insert(command.end(), {"--keys", keys});
  }
  ChildProcess server(command);
  const std::string before = " on 127.0.0.1:";
  if (!server.wait_for_err(before, std::chrono::seconds(30)) ||
      !server.wait_for_err("\n", std::chrono::seconds(5)))
    throw RunError("bench: " + o.program + " does not serve: " + server.err());
  const std::string said = server.err();
  const int port = std::atoi(said.c_str() + said.find(before) + before.size());
  const net::Address at = net::parse_address("127.0.0.1:" + std::to_string(port), "bench");

  std::vector<std::unique_ptr<WireStation>> stations;
  double first_kib = 0;
  while (stations.size() < o.to) {
    link::ClientConfig config;
    config.nonce_seed = stations.size() + 1;
    // An address of its own: the server bounds the handshakes of one.
    const std::size_t k = stations.size() + 1;
    const net::Address from = net::parse_address(
        "127.1." + std::to_string(k / 200) + "." + std::to_string(1 + k % 200) + ":0", "bench");
    stations.push_back(std::make_unique<WireStation>(at, config, secure, from));
    link::Command hold;
    hold.flags = link::kFlagClutch | link::kFlagDeadman;
    if (!stations.back()->exchange(20, hold, 30'000'000'000))
      throw RunError("bench: a session does not open");
    if (stations.size() == o.from) first_kib = resident_kib(server.pid());
  }
  const double last_kib = resident_kib(server.pid());
  server.signal(SIGTERM);
  server.wait(std::chrono::seconds(10));
  return (last_kib - first_kib) / static_cast<double>(o.to - o.from);
}

}  // namespace

std::vector<BenchRow> run_memory_bench(const MemoryBenchOptions& o) {
  constexpr double kTargetKib = 128;
  std::vector<BenchRow> rows;
  const auto row = [&](const char* name, const std::string& scene, bool encrypted) {
    rows.push_back({name, "kib_per_session", kib_per_session(o, scene, encrypted), {}, kTargetKib, false});
  };
  row("flat", o.flat, false);
  row("scan", o.scan, false);
#if TELENANO_WITH_DTLS
  row("flat_dtls", o.flat, true);
  row("scan_dtls", o.scan, true);
#endif
  return rows;
}

}  // namespace telenano::studies

// The house's include rules, checked on the source files themselves: who may include whom, and which library
// is seen through which door. A rule is a row; a new folder must be given a row before it may have files.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "tests/source_dir.h"

namespace {

namespace fs = std::filesystem;

struct Include {
  std::string file;    // relative to the project's root
  std::string target;  // as written between <> or "", without telenano/
};

const fs::path kRoot = TELENANO_SOURCE_DIR;
const std::vector<std::string> kTrees = {"common", "master", "nve_server"};
/// And the schema's, which is no library, and writes lines that look like includes.
const std::vector<std::string> kAllTrees = {"common", "master", "nve_server", "proto"};

std::string folder_of(const std::string& path) {
  return fs::path(path).parent_path().generic_string();
}

std::vector<Include> includes_of(const fs::path& tree) {
  std::vector<Include> all;
  for (const auto& entry : fs::recursive_directory_iterator(kRoot / tree)) {
    const auto extension = entry.path().extension();
    if (extension != ".h" && extension != ".cpp") continue;
    std::ifstream in(entry.path());
    for (std::string line; std::getline(in, line);) {
      if (tree == "proto" && line.starts_with("namespace")) break;
      const auto start = line.find_first_not_of(" \t");
      if (start == std::string::npos || line.compare(start, 8, "#include") != 0) continue;
      const auto open = line.find_first_of("<\"", start);
      const auto close = line.find_first_of(">\"", open + 1);
      if (open == std::string::npos || close == std::string::npos) continue;
      std::string target = line.substr(open + 1, close - open - 1);
      if (target.starts_with("telenano/")) target.erase(0, std::string("telenano/").size());
      all.push_back({fs::relative(entry.path(), kRoot).generic_string(), target});
    }
  }
  return all;
}

// Folder -> project folders that it may include besides itself.
const std::map<std::string, std::set<std::string>> kMayInclude = {
    {"proto/schema", {}},
    {"common/base", {}},
    {"common/config", {"common/base"}},
    {"common/hash", {"common/base"}},
    {"common/rt", {"common/base"}},
    {"common/control", {"common/base"}},
    {"common/link", {"common/base"}},
    {"common/net", {"common/base"}},
    {"common/recording", {"common/base", "common/rt"}},
    {"common/plot", {"common/base"}},
    {"common/surface", {"common/base"}},
    {"common/metrics", {"common/base", "common/net", "common/rt"}},
    {"common/security", {"common/base", "common/config", "common/link", "common/net", "common/rt"}},
    {"master/device", {"common/base", "common/control", "common/rt"}},
    {"master/device/omega", {"common/base", "master/device"}},
    {"master/device/hid", {"common/base", "common/rt", "master/device"}},
    {"master/calibration", {"common/base", "master/device"}},
    {"master/station", {"common/base", "common/control", "common/link", "master/device"}},
    {"master/loop",
     {"common/base", "common/rt", "common/link", "common/net", "common/recording", "master/device",
      "master/station"}},
    {"master/connection", {"common/base", "common/link", "common/net", "common/rt", "common/security"}},
    {"master/scene",
     {"common/base", "common/config", "common/hash", "common/link", "common/net", "common/recording",
      "common/rt", "common/surface", "master/loop", "nve_server/scene", "nve_server/slave"}},
    {"master/app",
     {"common/base",    "common/config",      "common/rt",         "common/control",    "common/link",
      "common/net",     "common/recording",   "common/metrics",    "common/plot",       "common/security",
      "common/surface", "master/calibration", "master/device",     "master/device/hid", "master/device/omega",
      "master/station", "master/loop",        "master/connection", "master/scene",      "master/view_model",
      "master/viewer",  "master/twin"}},
    {"master/view_model",
     {"common/base", "common/control", "common/link", "common/recording", "common/rt", "common/surface",
      "master/device", "master/station"}},
    {"master/viewer",
     {"common/base", "common/control", "common/link", "common/recording", "common/rt", "common/surface",
      "master/device", "master/station", "master/view_model"}},
    // Between the two: the server's slave behind the station's seam.
    {"master/twin", {"common/base", "common/control", "common/link", "nve_server/scene", "nve_server/slave"}},
    // The rooms of the physics have an order: each may include those before it, and no circle is possible.
    {"nve_server/physics/numerics", {"common/base"}},
    {"nve_server/physics/contact", {"common/base", "nve_server/physics/numerics"}},
    {"nve_server/physics/long_range", {"common/base", "nve_server/physics/numerics"}},
    {"nve_server/physics/law",
     {"common/base", "nve_server/physics/numerics", "nve_server/physics/contact",
      "nve_server/physics/long_range"}},
    {"nve_server/physics/surface",
     {"common/base", "common/surface", "nve_server/physics/numerics", "nve_server/physics/contact"}},
    {"nve_server/physics/potential",
     {"common/base", "nve_server/physics/numerics", "nve_server/physics/long_range", "nve_server/physics/law",
      "nve_server/physics/surface"}},
    {"nve_server/physics/equilibrium",
     {"common/base", "nve_server/physics/numerics", "nve_server/physics/contact", "nve_server/physics/law",
      "nve_server/physics/surface", "nve_server/physics/potential"}},
    {"nve_server/physics/particle",
     {"common/base", "nve_server/physics/numerics", "nve_server/physics/law", "nve_server/physics/surface",
      "nve_server/physics/potential", "nve_server/physics/equilibrium"}},
    {"nve_server/physics/probe",
     {"common/base", "nve_server/physics/numerics", "nve_server/physics/equilibrium"}},
    {"nve_server/scene", {"common/base", "common/config", "common/surface", "nve_server/physics"}},
    {"nve_server/import", {"common/base", "common/surface"}},
    {"nve_server/fit", {"common/base", "nve_server/physics"}},
    {"nve_server/slave", {"common/base", "common/link", "nve_server/physics", "nve_server/scene"}},
    {"nve_server/server", {"common/base", "common/link", "common/net", "common/rt", "nve_server/slave"}},
    {"nve_server/nanonis", {"common/base"}},
    {"nve_server/afm_sim",
     {"common/base", "common/net", "common/rt", "nve_server/nanonis", "nve_server/physics",
      "nve_server/scene"}},
    {"nve_server/afm",
     {"common/base", "common/config", "common/hash", "common/link", "common/net", "common/rt",
      "nve_server/nanonis", "nve_server/slave"}},
    {"nve_server/web", {"common/base", "common/net", "common/rt", "common/surface"}},
    {"nve_server/app",
     {"common/base",        "common/config",     "common/hash",       "common/metrics", "common/rt",
      "common/link",        "common/net",        "common/security",   "common/surface", "nve_server/physics",
      "nve_server/scene",   "nve_server/slave",  "nve_server/server", "nve_server/afm", "nve_server/afm_sim",
      "nve_server/nanonis", "nve_server/import", "nve_server/fit",    "nve_server/web", "common/plot"}},
};

// Header prefix -> the files (path prefixes) that may see it.
const std::vector<std::pair<std::string, std::vector<std::string>>> kDoors = {
    {"google/protobuf", {"common/link/codec", "proto/schema/"}},
    {"telenano.pb.h", {"common/link/codec"}},
    {"proto/telenano.pb.h", {"common/link/codec"}},
    {"proto/reply_columns.h", {"common/recording/sample.cpp", "master/loop/station_loop.cpp"}},
    {"boost/asio", {"common/net/udp", "common/net/tcp", "nve_server/web/web_view"}},
    {"boost/beast", {"nve_server/web/web_view"}},
    {"openssl/", {"common/security/dtls_", "common/hash/sha256"}},
    {"prometheus/", {"common/metrics/exporter"}},
    {"CivetServer.h", {"common/metrics/exporter"}},
    {"nlohmann/", {"nve_server/app/serve/audit_log"}},
    {"hdf5", {"common/recording/"}},
    {"H5", {"common/recording/"}},
    {"toml++", {"common/config/"}},
    {"zlib.h", {"nve_server/fit/zip_member"}},
    {"dlfcn.h", {"master/device/omega/sdk"}},
    {"hidapi", {"master/device/hid/hidapi_"}},
    {"systemd/", {"nve_server/app/serve/service_notify"}},
    {"CLI/", {"common/config/program", "common/config/completion", "master/app/", "nve_server/app/"}},
    {"GLFW", {"master/viewer/"}},
    {"epoxy/", {"master/viewer/gl", "master/viewer/offscreen", "master/viewer/window"}},
    {"imgui", {"master/viewer/"}},
    {"backends/imgui", {"master/viewer/"}},
    {"stb/", {"master/viewer/png"}},
    {"spdlog", {"master/app/", "nve_server/app/", "nve_server/server/server_loop"}},
};

// Pure folders: no clock, thread, file, socket or log.
const std::set<std::string> kPure = {"common/base",        "common/control",    "common/link",
                                     "master/station",     "master/view_model", "master/calibration",
                                     "nve_server/nanonis", "nve_server/import", "nve_server/fit"};
const std::set<std::string> kImpure = {"chrono",        "thread",       "mutex",      "condition_variable",
                                       "fstream",       "iostream",     "filesystem", "cstdio",
                                       "stdio.h",       "time.h",       "ctime",      "unistd.h",
                                       "sys/time.h",    "sys/socket.h", "pthread.h",  "sys/mman.h",
                                       "sched.h",       "future",       "semaphore",  "fmt/os.h",
                                       "fmt/ostream.h", "netinet/in.h", "random"};

/// The folder's own row, or that of the folder round it: the rooms of a program share one. "": none.
std::string row_of(std::string folder) {
  while (!folder.empty() && !kMayInclude.contains(folder)) folder = folder_of(folder);
  return folder;
}

/// Who may include a folder may include its rooms.
bool may_include(const std::string& from, std::string to) {
  const std::set<std::string>& allowed = kMayInclude.at(from);
  while (!to.empty() && !allowed.contains(to)) to = folder_of(to);
  return !to.empty();
}

TEST(IncludeRules, FoldersIncludeOnlyWhatTheyMay) {
  for (const auto& tree : kAllTrees) {
    for (const auto& [file, target] : includes_of(tree)) {
      const std::string from = row_of(folder_of(file));
      ASSERT_NE(from, "") << file << ": its folder has no row in kMayInclude";
      const std::string to = row_of(folder_of(target));
      if (to.empty() || to == from) continue;
      EXPECT_TRUE(may_include(from, to)) << file << " includes " << target;
    }
  }
}

// An installed header finds the others by the names that it has here; nobody else's folder is called
// telenano.
TEST(IncludeRules, IncludesOfTheProjectBeginWithItsName) {
  for (const auto* tree : {"common", "master", "nve_server", "tests", "deploy"}) {
    for (const auto& entry : fs::recursive_directory_iterator(kRoot / tree)) {
      const auto extension = entry.path().extension();
      if (extension != ".h" && extension != ".cpp") continue;
      std::ifstream in(entry.path());
      for (std::string line; std::getline(in, line);) {
        for (const auto& room : kTrees)
          EXPECT_FALSE(line.starts_with("#include \"" + room + "/")) << entry.path() << ": " << line;
      }
    }
  }
}

TEST(IncludeRules, MasterAndServerNeverMeet) {
  // A station knows scenes through two folders: those that it has fetched, and the slave that it runs itself.
  for (const auto& [file, target] : includes_of("master")) {
    const bool knows_scenes = file.starts_with("master/scene/") || file.starts_with("master/twin/");
    EXPECT_TRUE(knows_scenes || !target.starts_with("nve_server/")) << file;
  }
  for (const auto& [file, target] : includes_of("nve_server"))
    EXPECT_FALSE(target.starts_with("master/")) << file;
}

TEST(IncludeRules, OneLibraryOneDoor) {
  for (const auto& tree : kAllTrees) {
    for (const auto& [file, target] : includes_of(tree)) {
      for (const auto& [prefix, doors] : kDoors) {
        if (!target.starts_with(prefix)) continue;
        EXPECT_TRUE(
            std::any_of(doors.begin(), doors.end(), [&](const auto& door) { return file.starts_with(door); }))
            << file << " includes " << target;
      }
    }
  }
}

TEST(IncludeRules, PureFoldersSeeNoClockThreadFileSocketOrLog) {
  for (const auto& tree : kTrees) {
    for (const auto& [file, target] : includes_of(tree)) {
      const std::string folder = folder_of(file);
      const bool room_of_physics = folder.starts_with("nve_server/physics/");
      if (!room_of_physics && !kPure.contains(folder)) continue;
      EXPECT_FALSE(kImpure.contains(target)) << file << " includes <" << target << ">";
    }
  }
}

TEST(IncludeRules, SessionCodeUsesNoElementaryFunctionThatDependsOnTheMachine) {
  // glibc chooses code with or without fused multiply-add at run time; these must come from
  // common/base/det_math.
  const std::vector<std::string> forbidden = {"std::sin(",  "std::cos(",  "std::tan(",   "std::exp(",
                                              "std::log(",  "std::pow(",  "std::cbrt(",  "std::atan(",
                                              "std::acos(", "std::asin(", "std::hypot(", "std::atan2(",
                                              "std::sinh(", "std::cosh(", "std::fma("};
  const std::vector<std::string> folders = {"common/base",       "common/control",      "common/link",
                                            "common/net",        "nve_server/physics",  "nve_server/slave",
                                            "nve_server/server", "nve_server/scene",    "master/device",
                                            "master/device/hid", "master/device/omega", "master/station"};
  for (const auto& folder : folders) {
    for (const auto& entry : fs::recursive_directory_iterator(kRoot / folder)) {
      const auto extension = entry.path().extension();
      if (extension != ".h" && extension != ".cpp") continue;
      std::ifstream in(entry.path());
      int number = 0;
      for (std::string line; std::getline(in, line);) {
        ++number;
        if (const auto comment = line.find("//"); comment != std::string::npos) line.resize(comment);
        for (const auto& name : forbidden)
          EXPECT_EQ(line.find(name), std::string::npos)
              << entry.path() << ":" << number << " calls " << name << ")";
      }
    }
  }
}

// fmt::print throws where a disk is full, which would end a session in its loop or a thread of it.
TEST(IncludeRules, ProgramsPrintWithoutThrowing) {
  for (const auto* tree : {"common", "master", "nve_server"}) {
    for (const auto& entry : fs::recursive_directory_iterator(kRoot / tree)) {
      const auto extension = entry.path().extension();
      if (extension != ".h" && extension != ".cpp") continue;
      std::ifstream in(entry.path());
      int number = 0;
      for (std::string line; std::getline(in, line);) {
        ++number;
        EXPECT_EQ(line.find("fmt::print("), std::string::npos)
            << entry.path() << ":" << number << ": config::print does not throw";
      }
    }
  }
}

}  // namespace

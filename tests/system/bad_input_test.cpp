// Whatever a person gets wrong: one line on standard error that names it, the documented exit code, nothing
// on standard output, nothing written. 2 = wrong usage or configuration, 1 = failed while running.
#include <array>
#include <atomic>
#include <cstring>
#include <limits>
#include <map>
#include <thread>

#include "telenano/common/link/codec.h"
#include "telenano/common/link/messages.h"
#include "telenano/common/net/udp.h"
#include "telenano/common/recording/recording_reader.h"
#include "tests/source_dir.h"
#include "tests/system/programs.h"

namespace telenano::programs {
namespace {

struct Bad {
  std::string what;
  std::vector<std::string> command;
  std::vector<std::string> named;  ///< what the line must say
  int exit_code = 2;
};

class BadInputTest : public ProgramsTest {
 protected:
  void expect_refused(const Bad& bad, const ChildOptions& more = {}) {
    SCOPED_TRACE(bad.what);
    const auto before = listing();
    ChildOptions options = more;
    options.folder = folder_;
    const Finished run = run_program(bad.command, options, kLong);
    EXPECT_EQ(run.exit_code, bad.exit_code) << "signal " << run.ended_by << "\n" << run.err;
    EXPECT_EQ(run.out, "");
    const auto lines = lines_of(run.err);
    EXPECT_EQ(lines.size(), 1u) << run.err;
    if (!lines.empty()) {
      const std::string program = std::filesystem::path(bad.command[0]).filename().string();
      EXPECT_EQ(lines[0].rfind(program + ": ", 0), 0u) << run.err;
      EXPECT_LT(lines[0].size(), 400u) << "too long for a line:\n" << run.err;
    }
    for (const std::string& word : bad.named) {
      EXPECT_NE(run.err.find(word), std::string::npos) << "does not name '" << word << "':\n" << run.err;
    }
    EXPECT_EQ(listing(), before) << "something was written";
    if (std::getenv("TELENANO_SHOW") != nullptr) std::printf("%-28s %s", bad.what.c_str(), run.err.c_str());
  }
  void expect_refused(const std::vector<Bad>& table) {
    for (const Bad& bad : table) expect_refused(bad);
  }

  /// Files of the test's folder, with what is in them.
  std::map<std::string, std::string> listing() const {
    std::map<std::string, std::string> files;
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder_)) {
      files[entry.path().string()] = entry.is_regular_file() ? file_text(entry.path()) : "";
    }
    return files;
  }

  /// flakes.toml with one text replaced, beside its scan.
  std::string scene_with(const std::string& name, const std::string& from, const std::string& to) const {
    std::string text = file_text(scene_path("flakes"));
    const auto put = [&](const std::string& old, const std::string& fresh) {
      const auto at = text.find(old);
      EXPECT_NE(at, std::string::npos) << "the scene has no '" << old << "'";
      if (at != std::string::npos) text.replace(at, old.size(), fresh);
    };
    put(from, to);
    if (from.find("wsxm_600nm") == std::string::npos) {
      put("../data/wsxm_600nm.gsf", std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf");
    }
    return write(name, text);
  }

  static std::string real_scan() {
    return file_text(std::string(TELENANO_SOURCE_DIR) + "/deploy/data/wsxm_600nm.gsf");
  }

  /// A scene whose scan is `bytes`.
  std::string scene_of_scan(const std::string& name, const std::string& bytes) const {
    write(name + ".gsf", bytes);
    return scene_with(name + ".toml", "../data/wsxm_600nm.gsf", name + ".gsf");
  }

  static std::vector<std::string> with(std::vector<std::string> command,
                                       const std::vector<std::string>& more) {
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }
};

TEST_F(BadInputTest, FlagsOfTheStation) {
  const std::vector<std::string> run{kMaster, "run"};
  const std::string script = write("bad.csv", "t_s,x_nm,y_nm,z_nm\n0,0,0,20\n1,0,zero,20\n");
  const std::string backwards = write("backwards.csv", "t_s,x_nm,y_nm,z_nm\n0,0,0,20\n2,0,0,20\n1,0,0,20\n");
  const std::string station = write("station.toml", "[limits]\nslew_n = 5.0\n");
  const std::string outside = write("outside.toml", "[limits]\nslew_n_s = -5.0\n");
  const std::string not_toml = write("not.toml", "slew = = 5\n");
  expect_refused(std::vector<Bad>{
      {"no command",
       {kMaster},
       {"a command is missing", "run, replay, view, plan, devices, calibrate, enroll, recover or export",
        "telenano-master --help"}},
      {"unknown command",
       {kMaster, "rum"},
       {"'rum'", "run, replay, view, plan, devices, calibrate, enroll, recover or export",
        "did you mean run?"}},
      {"unknown flag", with(run, {"--tasks", "indent"}), {"--tasks", "did you mean --task?"}},
      {"flag without value", with(run, {"--task"}), {"--task"}},
      {"unknown task",
       with(run, {"--task", "polish"}),
       {"polish", "position, contact, indent, scan or script"}},
      {"unknown method", with(run, {"--method", "magic"}), {"magic", "none, ks, ks-clamp"}},
      {"unknown device", with(run, {"--device", "omega9"}), {"--device", "omega9", "sim"}},
      {"practice link",
       with(run, {"--practice-link", "rtt=9999"}),
       {"--practice-link rtt=9999", "0 to 2000"}},
      {"practice link's words",
       with(run, {"--practice-link", "delay=5"}),
       {"--practice-link delay=5", "rtt="}},
      {"rate no number", with(run, {"--rate", "fast"}), {"--rate", "fast"}},
      {"rate out of range", with(run, {"--rate", "50"}), {"--rate", "50", "100", "8000"}},
      {"rate nan", with(run, {"--rate", "nan"}), {"--rate"}},
      {"duration negative", with(run, {"--duration-s", "-1"}), {"--duration-s", "-1", "3600"}},
      {"duration nan", with(run, {"--duration-s", "nan"}), {"--duration-s"}},
      {"depth inf", with(run, {"--depth-nm", "inf"}), {"--depth-nm", "1000"}},
      {"undo nan", with(run, {"--undo-marks-at", "nan"}), {"--undo-marks-at", "finite"}},
      {"give up nan", with(run, {"--give-up-s", "nan"}), {"--give-up-s"}},
      {"force scale nan", with(run, {"--force-scale", "nan"}), {"scaling.force", "1 to 1e"}},
      {"velocity scale 0", with(run, {"--velocity-scale", "0"}), {"scaling.velocity", "1e-12 to 1"}},
      {"server without port", with(run, {"--server", "127.0.0.1"}), {"--server", "no port", "HOST:PORT"}},
      {"server port 99999", with(run, {"--server", "127.0.0.1:99999"}), {"--server", "99999", "0 to 65535"}},
      {"server off loopback",
       with(run, {"--server", "192.0.2.1:5100"}),
       {"--server", "192.0.2.1:5100", "loopback", "--key"}},
      {"script task, no script", with(run, {"--task", "script"}), {"--script", "t_s,x_nm,y_nm,z_nm"}},
      {"script missing", with(run, {"--task", "script", "--script", "none.csv"}), {"none.csv"}},
      {"script with a bad line",
       with(run, {"--task", "script", "--script", script}),
       {script + ":3", "four finite numbers"}},
      {"script backwards in time",
       with(run, {"--task", "script", "--script", backwards}),
       {backwards + ":4", "t_s"}},
      {"station file missing", with(run, {"--config", "none.toml"}), {"none.toml"}},
      {"station file, unknown key", with(run, {"--config", station}), {station, "slew_n", "slew_n_s"}},
      {"station file, out of range",
       with(run, {"--config", outside}),
       {outside, "slew_n_s", "-5", "[1, 1000000]"}},
      {"station file, no TOML", with(run, {"--config", not_toml}), {not_toml}},
  });
}

TEST_F(BadInputTest, Plans) {
  const std::string limits = path("limits.toml");
  ASSERT_EQ(run_program({kNve, "check", "--scene", scene_path("flat_pdms"), "--limits", limits}).exit_code,
            0);
  const std::string good = file_text(limits);
  const auto with_line = [&](const std::string& name, const std::string& key, const std::string& line) {
    std::string text = good;
    const auto begin = text.find(key + " = ");
    EXPECT_NE(begin, std::string::npos) << key;
    text.replace(begin, text.find('\n', begin) - begin, line);
    return write(name, text);
  };
  const std::string soft = with_line("soft.toml", "coupling_stiffness_n_m", "coupling_stiffness_n_m = 0.0");
  const std::string nan = with_line("nan.toml", "force_max_nn", "force_max_nn = nan");
  const std::string unknown = with_line("unknown.toml", "force_max_nn", "force_max = 5.0");
  const std::string slow = with_line("slow.toml", "rate_max_hz", "rate_max_hz = 500.0");
  net::Udp nobody = net::Udp::listen(net::parse_address("127.0.0.1:0", "test"));
  const std::string silent = "127.0.0.1:" + std::to_string(nobody.local().port);
  const std::vector<std::string> plan{kMaster, "plan"};
  const std::vector<std::string> known{kMaster, "plan", "--limits", limits};
  expect_refused(std::vector<Bad>{
      {"no source", plan, {"plan", "--server HOST:PORT", "--limits FILE"}},
      {"both sources", with(known, {"--server", silent}), {"either --server", "or --limits"}},
      {"limits missing", with(plan, {"--limits", "none.toml"}), {"none.toml", "No such file"}},
      {"limits without a spring", with(plan, {"--limits", soft}), {soft, "coupling_stiffness_n_m", "> 0"}},
      {"limits with nan", with(plan, {"--limits", nan}), {nan, "force_max_nn", "nan"}},
      {"limits, unknown key", with(plan, {"--limits", unknown}), {unknown, "force_max"}},
      {"limits of a slow slave", with(plan, {"--limits", slow}), {slow, "500", "1000", "--rate"}},
      {"rtt nan", with(known, {"--rtt-ms", "nan"}), {"--rtt-ms", "nan", "0 to 60000"}},
      {"rtt negative", with(known, {"--rtt-ms", "-1"}), {"--rtt-ms", "-1", "0 to 60000"}},
      {"rtt inf", with(known, {"--rtt-ms", "inf"}), {"--rtt-ms", "inf", "0 to 60000"}},
      {"rtt no number", with(known, {"--rtt-ms", "far"}), {"--rtt-ms", "far"}},
      {"haptic nan", with(known, {"--haptic-m", "nan"}), {"--haptic-m", "nan", "> 0"}},
      {"visual 0", with(known, {"--visual-m", "0"}), {"--visual-m", "0", "> 0"}},
      {"nano inf", with(known, {"--nano-nm", "inf"}), {"--nano-nm", "inf", "> 0"}},
      {"nano larger than the hand's",
       with(known, {"--nano-nm", "1e9", "--haptic-m", "0.1"}),
       {"velocity", "1e-12 to 1"}},
      {"rate nan", with(known, {"--rate", "nan"}), {"rate_hz", "nan"}},
      {"unknown method", with(known, {"--method", "magic"}), {"magic", "none, ks"}},
      {"unknown device", with(known, {"--device", "omega9"}), {"--device", "omega9", "sim"}},
      {"device without force", with(known, {"--device", "mouse"}), {"--device mouse", "sim or omega"}},
      {"station file missing", with(known, {"--station", "none.toml"}), {"none.toml"}},
      {"plot of no kind", with(known, {"--plot", "plan.pdf"}), {"--plot", "plan.pdf", ".svg or .png"}},
      {"plot nowhere", with(known, {"--plot", "none/plan.svg"}), {"--plot", "none/plan.svg"}},
      {"server off loopback", with(plan, {"--server", "192.0.2.1:5100"}), {"192.0.2.1:5100", "loopback"}},
      {"timeout nan",
       with(plan, {"--server", silent, "--connect-timeout-s", "nan"}),
       {"--connect-timeout-s"}},
      {"silent server",
       with(plan, {"--server", silent, "--connect-timeout-s", "0.5"}),
       {"no answer from " + silent, "0.5 s"},
       1},
  });
}

TEST_F(BadInputTest, ScenesAndScans) {
  const auto check = [](const std::string& scene) {
    return std::vector<std::string>{kNve, "check", "--scene", scene};
  };
  const std::string scan = real_scan();
  std::string seconds = scan;
  ASSERT_NE(seconds.find("XYUnits = m\n"), std::string::npos);
  seconds.replace(seconds.find("XYUnits = m\n"), 12, "XYUnits = s\n");
  std::string nan = scan;
  const float not_a_number = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = scan.size() - 4 * 1000; i < scan.size(); i += 4)
    std::memcpy(nan.data() + i, &not_a_number, 4);
  const std::string poisson = scene_with("poisson.toml", "poisson_ratio = 0.27", "poisson_ratio = 0.7");
  const std::string modulus =
      scene_with("modulus.toml", "youngs_modulus_gpa = 70.0", "youngs_modulus_gpa = -70.0");
  const std::string unknown = scene_with("unknown.toml", "van_der_waals = true", "van_der_wals = true");
  const std::string unit = scene_with("unit.toml", "youngs_modulus_gpa = 70.0", "youngs_modulus_pa = 70.0e9");
  const std::string text = scene_with("text.toml", "tip_radius_nm = 20.0", "tip_radius_nm = \"20\"");
  const std::string nan_key = scene_with("radius.toml", "tip_radius_nm = 20.0", "tip_radius_nm = nan");
  const std::string kind = scene_with("kind.toml", "kind = \"scan\"", "kind = \"scam\"");
  const std::string outside = scene_with("outside.toml", "x_nm = 300.0", "x_nm = 3000.0");
  expect_refused(std::vector<Bad>{
      {"missing scene", check("none.toml"), {"none.toml", "has only: flakes"}},
      {"scene is a folder", check("."), {"."}},
      {"scene without end", check("/dev/zero"), {"/dev/zero", "1 MiB", "TOML"}},
      {"scan without end",
       check(scene_with("zero.toml", "../data/wsxm_600nm.gsf", "/dev/zero")),
       {"/dev/zero", "longer than the largest scan"}},
      {"unknown key", check(unknown), {unknown, "van_der_wals", "van_der_waals"}},
      {"wrong unit", check(unit), {unit, "youngs_modulus_pa", "youngs_modulus_gpa"}},
      {"poisson 0.7", check(poisson), {poisson, "'poisson_ratio' in [sample]", "0.7", "(-1, 0.5]"}},
      {"negative modulus",
       check(modulus),
       {modulus, "'youngs_modulus_gpa' in [sample]", "-70", "[0.0001, 2000]"}},
      {"text for a number", check(text), {text, "tip_radius_nm"}},
      {"nan for a number", check(nan_key), {nan_key, "tip_radius_nm", "nan"}},
      {"unknown kind", check(kind), {kind, "scam", "flat", "scan"}},
      {"start outside", check(outside), {outside, "'x_nm' in [start]", "3000"}},
      {"missing scan",
       check(scene_with("noscan.toml", "../data/wsxm_600nm.gsf", "none.gsf")),
       {"none.gsf", "No such file"}},
      {"truncated scan",
       check(scene_of_scan("cut", scan.substr(0, scan.size() - 100))),
       {"cut.gsf", "truncated", std::to_string(scan.size())}},
      {"empty scan", check(scene_of_scan("empty", "")), {"empty.gsf", "Gwyddion Simple Field"}},
      {"NaN-filled scan", check(scene_of_scan("nan", nan)), {"nan.gsf", "1000 of", "not finite"}},
      {"scan in seconds", check(scene_of_scan("seconds", seconds)), {"seconds.gsf", "XYUnits", "'s'", "'m'"}},
      {"serve: unknown key",
       {kNve, "serve", "--listen", "127.0.0.1:0", "--scene", unknown},
       {unknown, "van_der_wals"}},
      {"curve: unknown key", {kNve, "curve", "--scene", unknown}, {unknown, "van_der_wals"}},
      {"curve: outside",
       {kNve, "curve", "--scene", scene_path("flakes"), "--x-nm", "9999"},
       {"--x-nm", "9999", "[26.17"}},
      {"curve: nan", {kNve, "curve", "--scene", scene_path("flakes"), "--y-nm", "nan"}, {"--y-nm", "nan"}},
      {"curve: upwards",
       {kNve, "curve", "--scene", scene_path("flakes"), "--from-nm", "0", "--to-nm", "5"},
       {"--to-nm", "5"}},
      {"curve: no step",
       {kNve, "curve", "--scene", scene_path("flakes"), "--step-nm", "0"},
       {"--step-nm", "0"}},
      {"curve: step no number",
       {kNve, "curve", "--scene", scene_path("flakes"), "--step-nm", "x"},
       {"--step-nm", "x"}},
  });
}

TEST_F(BadInputTest, FlagsOfTheServerAndTheLaboratory) {
  const std::string scene = scene_path("flat_silicon_oxide");
  net::Udp taken = net::Udp::listen(net::parse_address("127.0.0.1:0", "test"));
  const std::string port = std::to_string(taken.local().port);
  const std::string text = write("notes.txt", "no recording\n");
  write("empty.h5", "");
  const std::vector<std::string> relay{kLab, "relay", "--listen", "127.0.0.1:0"};
  const std::vector<std::string> good_relay = with(relay, {"--to", "127.0.0.1:5100"});
  expect_refused(std::vector<Bad>{
      {"port in use", {kNve, "serve", "--scene", scene, "--listen", "127.0.0.1:" + port}, {port, "in use"}},
      {"off loopback without keys",
       {kNve, "serve", "--scene", scene, "--listen", "192.0.2.1:5100"},
       {"192.0.2.1:5100", "off loopback", "--keys"}},
      {"listen without port",
       {kNve, "serve", "--scene", scene, "--listen", "127.0.0.1"},
       {"--listen", "HOST:PORT"}},
      {"real time that spins",
       {kNve, "serve", "--scene", scene, "--busy-poll", "--rt-priority", "50"},
       {"--rt-priority", "--busy-poll"}},
      {"no such priority",
       {kNve, "serve", "--scene", scene, "--rt-priority", "100"},
       {"--rt-priority", "99"}},
      {"no scene", {kNve, "serve"}, {"--scene"}},
      {"no sessions", {kNve, "serve", "--scene", scene, "--max-sessions", "0"}, {"--max-sessions", "4096"}},
      {"no share",
       {kNve, "serve", "--scene", scene, "--sessions-per-peer", "0"},
       {"--sessions-per-peer", "4096"}},
      {"no such right", {kNve, "serve", "--scene", scene, "--local-rights", "all"}, {"--local-rights"}},
      {"a right for all beside keys",
       {kNve, "serve", "--scene", scene, "--local-rights", "observe", "--keys", "keys.toml"},
       {"--local-rights", "--rights"}},
      {"unknown flag", {kNve, "serve", "--scene", scene, "--prot", "5100"}, {"unknown flag --prot"}},
      {"recover a text file", {kMaster, "recover", text}, {text, "recording"}},
      {"recover nothing", {kMaster, "recover", "none.h5"}, {"none.h5"}},
      {"recover an empty file", {kMaster, "recover", "empty.h5"}, {"empty.h5"}},
      {"recover without file", {kMaster, "recover"}, {"FILE"}},
      {"report of a text file", {kLab, "report", "--run", "a=" + text}, {text, "recording"}},
      {"report of nothing", {kLab, "report", "--run", "a=none.h5"}, {"none.h5"}},
      {"report without label", {kLab, "report", "--run", "none.h5"}, {"--run", "LABEL=FILE"}},
      {"report without run", {kLab, "report"}, {"--run"}},
      {"unknown law", {kLab, "contact", "--law", "jkr", "--lambda", "1", "--delta", "0"}, {"jkr", "md"}},
      {"lambda no number", {kLab, "contact", "--lambda", "1,x", "--delta", "0"}, {"--lambda", "'x'"}},
      {"lambda negative", {kLab, "contact", "--lambda=-1", "--delta", "0"}, {"--lambda", "-1", "1e-06"}},
      {"delta nan", {kLab, "contact", "--lambda", "1", "--delta", "nan"}, {"--delta", "nan"}},
      {"no delta", {kLab, "contact", "--lambda", "1"}, {"--delta"}},
      {"direction",
       {kLab, "contact", "--lambda", "1", "--delta", "0", "--direction", "up"},
       {"--direction", "up"}},
      {"session: nan", {kLab, "session", "--scene", scene, "--rtt-ms", "nan"}, {"--rtt-ms"}},
      {"methods: round trip",
       {kLab, "methods", "--rtt-ms", "0,-1", "--out", "methods"},
       {"methods: --rtt-ms: -1", "0 to 2000"}},
      {"methods: nan", {kLab, "methods", "--rtt-ms", "nan", "--out", "methods"}, {"--rtt-ms: nan"}},
      {"methods: inf", {kLab, "methods", "--rtt-ms", "inf", "--out", "methods"}, {"--rtt-ms: inf"}},
      {"methods: no number", {kLab, "methods", "--rtt-ms", "0,x", "--out", "methods"}, {"--rtt-ms", "'x'"}},
      {"methods: unknown", {kLab, "methods", "--methods", "none,magic", "--out", "methods"}, {"'magic'"}},
      {"methods: part", {kLab, "methods", "--only", "all", "--out", "methods"}, {"--only: 'all'", "press"}},
      {"methods: no folder", {kLab, "methods", "--out", text + "/x"}, {text + "/x", "cannot be created"}},
      {"relay: no server", {kLab, "relay", "--listen", "127.0.0.1:0"}, {"--to"}},
      {"relay: address", with(relay, {"--to", "here"}), {"--to", "'here'", "HOST:PORT"}},
      {"relay: port in use",
       {kLab, "relay", "--listen", "127.0.0.1:" + port, "--to", "127.0.0.1:5100"},
       {port, "in use"}},
      {"relay: itself",
       {kLab, "relay", "--listen", "127.0.0.1:5100", "--to", "127.0.0.1:5100"},
       {"--to: '127.0.0.1:5100'", "itself"}},
      {"relay: exposed",
       {kLab, "relay", "--listen", "0.0.0.0:0", "--to", "127.0.0.1:5100"},
       {"0.0.0.0:0", "off loopback", "--expose"}},
      {"relay: nan", with(good_relay, {"--delay-ms", "nan"}), {"--delay-ms: nan", "0 to 60000"}},
      {"relay: inf", with(good_relay, {"--rate-bit-s", "inf"}), {"--rate-bit-s: inf", "10000000000"}},
      {"relay: duration nan", with(good_relay, {"--duration-s", "nan"}), {"--duration-s: nan", "1000000"}},
      {"relay: idle", with(good_relay, {"--idle-s", "0"}), {"--idle-s: 0;", "0.1"}},
      {"relay: loss", with(good_relay, {"--loss", "0.1,1.5"}), {"--loss: 1.5", "0 to 1"}},
      {"relay: three", with(good_relay, {"--loss", "0,0,0"}), {"--loss", "3 numbers"}},
      {"relay: word", with(good_relay, {"--corrupt", "some"}), {"--corrupt", "'some'"}},
      {"relay: slow", with(good_relay, {"--rate-bit-s", "10"}), {"--rate-bit-s: 10", "1000"}},
      {"relay: queue", with(good_relay, {"--queue-bytes", "1"}), {"--queue-bytes: 1;", "100"}},
      {"relay: jitter", with(good_relay, {"--jitter", "pareto"}), {"'pareto'", "half-normal"}},
      {"relay: bursts",
       with(good_relay, {"--burst", "5", "--burst-ms", "5"}),
       {"--burst-ms", "leave one out"}},
      {"relay: no such bursts",
       with(good_relay, {"--burst", "2", "--loss", "0.9"}),
       {"--loss: 0.9", "2 datagrams", "0.666667"}},
      {"relay: outage", with(good_relay, {"--outage", "5"}), {"--outage", "'5'", "START:LENGTH"}},
      {"relay: outage nan", with(good_relay, {"--outage", "5:nan"}), {"--outage: nan"}},
      {"relay: random outage", with(good_relay, {"--random-outage", "0:1"}), {"--random-outage: 0", "0.001"}},
      {"relay: no trace", with(good_relay, {"--trace", "none.csv"}), {"none.csv", "cannot be read"}},
      {"relay: trace", with(good_relay, {"--trace", text}), {text, "line 1", "time_s,delay_ms,lost"}},
      {"relay: clients", with(good_relay, {"--max-clients", "0"}), {"--max-clients: 0", "1024"}},
      {"session: task", {kLab, "session", "--scene", scene, "--task", "polish"}, {"polish"}},
  });
}

// What the server may leave out of its replies: a number of thousandths for the station and the study of what is felt, a
// sweep of its own for the stress laboratory, whose runs name theirs.
TEST_F(BadInputTest, DeadbandsOfReplies) {
  const std::vector<std::string> run{kMaster, "run"};
  const std::vector<std::string> fidelity{kLab, "fidelity", "--quick", "--out", "felt"};
  const std::vector<std::string> stress{kLab, "stress", "--out", "stress"};
  std::vector<Bad> table;
  for (const std::string value : {"nan", "-nan", "-1", "2000", "inf", "x", "10x"}) {
    const std::string flag = "--reply-deadband";
    table.push_back({"run: " + value, with(run, {flag, value}), {flag, value}});
    table.push_back({"fidelity: " + value, with(fidelity, {flag, value}), {flag, value, "1 to 1000"}});
    table.push_back({"stress: " + value, with(stress, {flag + "=" + value}), {flag, value}});
    table.push_back({"stress, a run: " + value,
                     {kLab, "stress", "--replay", "reply-permille=" + value},
                     {"reply-permille", value}});
    const std::string toml = value == "-nan" || value == "x" || value == "10x" ? "\"" + value + "\"" : value;
    const std::string station = write("station.toml", "[link]\nreply_deadband_permille = " + toml + "\n");
    table.push_back(
        {"station file: " + value, with(run, {"--config", station}), {station, "reply_deadband_permille"}});
    expect_refused(table);
    table.clear();
  }
  expect_refused(std::vector<Bad>{
      {"stress: a word more", with(stress, {"--reply-deadband", "100"}), {"100"}},
      {"stress: with a twin",
       with(stress, {"--reply-deadband", "--methods", "twin"}),
       {"with a twin no reply is left out"}},
      {"floor", {kLab, "stress", "--replay", "reply-n=200"}, {"reply-n", "200", "0 to 100"}},
  });
}

TEST_F(BadInputTest, WhatOnlyAServerCanTell) {
  // One place and no time-out to speak of: a refused station must say Bye, or the next finds the server full.
  Server server(scene_path("flat_silicon_oxide"), 0, {"--max-sessions", "1", "--timeout-ms", "60000"});
  const std::vector<std::string> run{kMaster,  "run",      "--server",     server.address(),
                                     "--task", "position", "--duration-s", "1"};
  write("old.h5", "somebody's recording\n");
  expect_refused(std::vector<Bad>{
      {"scaling",
       with(run, {"--velocity-scale", "1e-6", "--force-scale", "8e8"}),
       {"velocity scale 1e-06 x force scale 8e+08 = 800", "lower --force-scale", "--allow-unsafe-scaling"}},
      {"no folder", with(run, {"--record", "none/new.h5"}), {"none/new.h5", "No such file"}},
      {"exists", with(run, {"--record", "old.h5"}), {"old.h5", "exists already", "--overwrite"}},
      {"a folder", with(run, {"--record", ".", "--overwrite"}), {".", "directory"}},
  });
  ChildOptions no_room;
  no_room.file_bytes_max = 1000;
  expect_refused({"no room at all", with(run, {"--record", "new.h5"}), {"new.h5", "cannot be"}}, no_room);

  // The scale that the refusal names is accepted.
  const Finished refused = run_program(with(run, {"--velocity-scale", "1e-6", "--force-scale", "8e8"}));
  const std::string before = "to ";
  const auto at = refused.err.find(before, refused.err.find("lower --force-scale"));
  ASSERT_NE(at, std::string::npos) << refused.err;
  const std::string scale =
      refused.err.substr(at + before.size(), refused.err.find(' ', at + before.size()) - at - before.size());
  const Finished accepted =
      run_program(with(run, {"--quiet", "--velocity-scale", "1e-6", "--force-scale", scale}), {}, kLong);
  EXPECT_EQ(accepted.exit_code, 0) << scale << ": " << accepted.err;
  const Finished insisted = run_program(
      with(run, {"--quiet", "--velocity-scale", "1e-6", "--force-scale", "8e8", "--allow-unsafe-scaling"}),
      {}, kLong);
  EXPECT_EQ(insisted.exit_code, 0) << insisted.err;
}

TEST_F(BadInputTest, NoServerAndTheWrongServer) {
  net::Udp nobody = net::Udp::listen(net::parse_address("127.0.0.1:0", "test"));
  const std::string silent = "127.0.0.1:" + std::to_string(nobody.local().port);
  const std::vector<std::string> run{kMaster, "run",     "--record", path("new.h5"), "--connect-timeout-s",
                                     "0.5",   "--server"};
  expect_refused(Bad{"silent",
                     with(run, {silent}),
                     {"no answer from " + silent, "0.5 s", "telenano-nve serve", "firewall"},
                     1});
  expect_refused(
      Bad{"closed port",
          with(run, {"127.0.0.1:1"}),
          {"no answer from 127.0.0.1:1", "nothing listens on UDP port 1 there", "telenano-nve serve"},
          1});

  // Answers every Hello in version 9: with a Refuse, which every version reads, or with something of its own.
  for (const bool refuses : {true, false}) {
    net::Udp socket = net::Udp::listen(net::parse_address("127.0.0.1:0", "test"));
    const std::string address = "127.0.0.1:" + std::to_string(socket.local().port);
    std::atomic<bool> done{false};
    std::thread responder([&] {
      link::Codec codec;
      link::Incoming incoming;
      std::array<std::uint8_t, link::kMaxDatagramBytes> bytes;
      net::Received received;
      while (!done) {
        socket.wait_readable(5'000'000);
        while (socket.receive(bytes, received)) {
          if (codec.decode({bytes.data(), received.size}, incoming) != link::DropCause::kNone) continue;
          std::size_t size = 0;
          if (refuses) {
            size =
                codec.encode(link::Refuse{incoming.hello.nonce, link::RefuseReason::kVersion, 9, 9}, bytes);
          } else {
            size = codec.encode(link::Challenge{incoming.hello.nonce, 77}, bytes);
          }
          bytes[4] = 9;  // version, in the header
          socket.send({bytes.data(), size}, received.from);
        }
      }
    });
    expect_refused(Bad{refuses ? "version 9, refusing" : "version 9, chattering",
                       with(run, {address}),
                       {address, "version", "update"},
                       1});
    done = true;
    responder.join();
  }
}

/// A disk that fills up while a session runs: told once, the session goes on to its end, exit code 1, and
/// what had been confirmed is there.
TEST_F(BadInputTest, AFullDiskEndsTheRecordingAndNotTheSession) {
  Server server(scene_path("flakes"));
  ChildOptions small;
  small.file_bytes_max = 1'400'000;  // of these the scene takes 0.35 MB
  const std::string file = path("full.h5");
  const auto begin = std::chrono::steady_clock::now();
  const Finished run =
      run_program(station(server, {"--task", "indent", "--duration-s", "8", "--record", file}), small, kLong);
  const double took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  EXPECT_EQ(run.exit_code, 1) << "signal " << run.ended_by << run.err;
  EXPECT_EQ(run.out, "");
  std::size_t told = 0;
  for (const std::string& line : lines_of(run.err)) {
    if (line.find("the session goes on") != std::string::npos) {
      ++told;
      EXPECT_NE(line.find(file), std::string::npos) << line;
      EXPECT_NE(line.find("File too large"), std::string::npos) << line;
    }
  }
  EXPECT_EQ(told, 1u) << run.err;
  EXPECT_GE(took_s, 8) << "the session was cut short";
  EXPECT_NE(run.err.find("pull-off force"), std::string::npos) << run.err;
  {
    const recording::RecordingReader reader(file);
    EXPECT_TRUE(reader.cut_short());
    EXPECT_GT(reader.rows(), 300u);
  }
  EXPECT_EQ(run_program({kMaster, "recover", file}).exit_code, 0);
  EXPECT_NE(server.stop().find("in 1 sessions"), std::string::npos);
}

}  // namespace
}  // namespace telenano::programs

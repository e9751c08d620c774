// Another sample chosen in the window, and what may go wrong meanwhile: the server says no, or nothing; the device is
// unplugged; somebody reads the metrics. By keys and mouse as a person would, under Xvfb.
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <cstring>
#include <thread>

#include "tests/support/standin_drd/standin_sdk.h"
#include "tests/system/recorded.h"
#include "tests/system/viewer_programs.h"

namespace telenano::programs {
namespace {

using recording::RecordingReader;

constexpr double kStopped = 4;  // station::Mode

std::vector<std::string> scene_flags(const std::vector<std::string>& scenes) {
  std::vector<std::string> flags;
  for (const std::string& scene : scenes) flags.insert(flags.end(), {"--scene", scene_path(scene)});
  return flags;
}

/// Between station and server: drops what asks for another scene, on the way to the server.
class DeafToSwitches {
 public:
  explicit DeafToSwitches(int server_port) {
    socket_ = ::socket(AF_INET, SOCK_DGRAM, 0);
    server_ = loopback(server_port);
    sockaddr_in own = loopback(0);
    socklen_t size = sizeof own;
    EXPECT_EQ(::bind(socket_, reinterpret_cast<sockaddr*>(&own), size), 0);
    EXPECT_EQ(::getsockname(socket_, reinterpret_cast<sockaddr*>(&own), &size), 0);
    port_ = ntohs(own.sin_port);
    thread_ = std::thread([this] { run(); });
  }
  ~DeafToSwitches() {
    over_ = true;
    thread_.join();
    ::close(socket_);
  }
  int port() const { return port_; }
  int dropped() const { return dropped_; }

 private:
  static sockaddr_in loopback(int port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    return address;
  }
  void run() {
    constexpr std::size_t kTypeAt = 5;         // PROTOCOL.md, section 1
    constexpr std::uint8_t kSceneSwitch = 14;  // section 2
    sockaddr_in station{};
    std::array<std::uint8_t, 2048> bytes{};
    while (!over_) {
      pollfd waits{socket_, POLLIN, 0};
      if (::poll(&waits, 1, 20) <= 0) continue;
      sockaddr_in from{};
      socklen_t from_size = sizeof from;
      const ssize_t size =
          ::recvfrom(socket_, bytes.data(), bytes.size(), 0, reinterpret_cast<sockaddr*>(&from), &from_size);
      if (size <= 0) continue;
      const bool down = from.sin_port == server_.sin_port;
      if (!down) station = from;
      if (!down && size > 5 && bytes[kTypeAt] == kSceneSwitch) {
        ++dropped_;
        continue;
      }
      const sockaddr_in& to = down ? station : server_;
      ::sendto(socket_, bytes.data(), static_cast<std::size_t>(size), 0,
               reinterpret_cast<const sockaddr*>(&to), sizeof to);
    }
  }

  int socket_ = -1;
  int port_ = 0;
  sockaddr_in server_{};
  std::atomic<int> dropped_{0};
  std::atomic<bool> over_{false};
  std::thread thread_;
};

/// Of a recording: the greatest force on the hand before and after its event with this text; -1: there is none.
struct Felt {
  double before_n = -1;
  double after_n = -1;
};
Felt felt_about(const std::string& file, const std::string& text) {
  const RecordingReader reader(file);
  double at_s = -1;
  for (const recording::Event& event : reader.events())
    if (text == event.text.data()) at_s = event.time_s;
  Felt felt;
  if (at_s < 0) return felt;
  const auto time_s = reader.read("time_s");
  const auto force_n = reader.read("hand_force_applied_h_n", 2);
  for (std::size_t i = 0; i < time_s.size(); ++i) {
    double& most = time_s[i] < at_s ? felt.before_n : felt.after_n;
    most = std::max(most, std::abs(force_n[i]));
  }
  return felt;
}

class ViewerSwitch : public ViewerPrograms {
 protected:
  /// A person who chooses the last sample of the list of three while the tip presses on the first one, and who goes on
  /// when a file 'go' is there; meanwhile the caller looks. `environment`: of the station, NAME=VALUE.
  std::unique_ptr<ChildProcess> person(const std::string& station, const std::string& then,
                                       const std::string& environment = "") {
    std::ofstream(path("user.sh"))
        << "cd " << folder_.string()
        << kPerson
        // A server withdraws the tip of a station that this machine has kept waiting: then another one presses.
        << "for attempt in 1 2 3 4; do\n"
           "rm -f s.h5\n"
        << environment << " " << kMaster << " run " << station
        << " --view --record s.h5 2>err.txt &\n"
           "master=$!\n"
           "see 'Telenano: flakes at'; await 'above \"$(told force)\" 1 || above \"$(time_told)\" 9'\n"
           "above \"$(told force)\" 1 && break\n"
           "press_until ctrl+q '! kill -0 $master 2>/dev/null'\n"
           "done\n"
           "touch pressed\n"
           "await '[ -e choose ]'\n"
           "xdotool mousemove 1115 732 click 1; sleep 2\n"
           "xdotool mousemove 1050 705 click 1; touch chosen\n"
        << then
        << "await '[ -e go ]'\n"
           "kill -0 $master && echo lives\n"
           "press_until p '[ -s telenano-1.png ]'\n"
           "xdotool key ctrl+q; wait $master; echo ended with $?\n";
    return std::make_unique<ChildProcess>(std::vector<std::string>{
        "/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")});
  }
  ::testing::AssertionResult wait_for_mode(ChildProcess& user, double wanted) {
    return wait_for(user, path("s.h5"), [wanted](const RecordingReader& reader) {
      const auto mode = reader.read("station_mode");
      return !mode.empty() && mode.back() == wanted;
    });
  }
  void touch(const std::string& name) { std::ofstream(path(name)) << "now"; }
  bool appears(const std::string& name, Seconds most = 2 * kLong) {
    const auto end = std::chrono::steady_clock::now() + most;
    while (std::chrono::steady_clock::now() < end) {
      if (std::filesystem::exists(path(name))) return true;
      std::this_thread::sleep_for(Milliseconds(50));
    }
    return false;
  }
  void keep_picture(const std::string& name) {
    if (const char* folder = std::getenv("TELENANO_LOOK");
        folder != nullptr && std::filesystem::exists(path("telenano-1.png")))
      std::filesystem::copy_file(path("telenano-1.png"), std::string(folder) + "/" + name + ".png",
                                 std::filesystem::copy_options::overwrite_existing);
  }
  std::string said() { return file_text(path("err.txt")); }
};

// The server that is there by now has other samples than the list of the one that was: it says no, and the session goes on
// where it is, with its recording.
TEST_F(ViewerSwitch, ASampleThatIsRefusedLeavesTheSessionWhereItIs) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  auto server =
      std::make_unique<Server>(scene_path("flakes"), 0, scene_flags({"flat_pdms", "flat_silicon_oxide"}));
  const int port = server->port();
  const auto user = person("--server " + server->address(), "");
  ASSERT_TRUE(appears("pressed")) << said();
  server->child().signal(SIGKILL);
  ASSERT_TRUE(server->child().wait(kLong));
  server = std::make_unique<Server>(scene_path("flakes"), port, scene_flags({"flat_pdms"}));
  EXPECT_TRUE(wait_for_event(*user, path("s.h5"), "session resumed in a new epoch")) << said();
  EXPECT_TRUE(wait_for_mode(*user, kEngaged)) << said();
  touch("choose");
  EXPECT_TRUE(wait_for_event(*user, path("s.h5"), "another sample refused")) << said();
  touch("go");
  ASSERT_TRUE(user->wait(2 * kLong)) << said();
  EXPECT_EQ(user->out(), "lives\nended with 0\n") << said();
  keep_picture("refused");
  EXPECT_FALSE(std::filesystem::exists(path("s-2.h5"))) << "no other sample, no other recording";
  const RecordingReader reader(path("s.h5"));
  EXPECT_TRUE(reader.closed());
  EXPECT_EQ(reader.rows_dropped(), 0u);
  EXPECT_EQ(reader.read("station_mode").back() == kStopped, true) << "by Ctrl+Q, at its very end only";
}

// Another server that answers all but this. After half a minute a line says so, and what was held goes on.
TEST_F(ViewerSwitch, AServerThatDoesNotAnswerTheWishIsNotWaitedForForEver) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flakes"), 0, scene_flags({"flat_pdms", "flat_silicon_oxide"}));
  const DeafToSwitches deaf(server.port());
  const auto user = person("--server 127.0.0.1:" + std::to_string(deaf.port()), "");
  ASSERT_TRUE(appears("pressed")) << said();
  touch("choose");
  EXPECT_TRUE(wait_for_event(*user, path("s.h5"), "another sample wanted: lets go")) << said();
  EXPECT_TRUE(wait_for_event(*user, path("s.h5"), "another sample: no answer")) << said();
  EXPECT_TRUE(wait_for_mode(*user, kEngaged)) << said();
  touch("go");
  ASSERT_TRUE(user->wait(2 * kLong)) << said();
  EXPECT_EQ(user->out(), "lives\nended with 0\n") << said();
  keep_picture("no_answer");
  EXPECT_GT(deaf.dropped(), 3) << "it was asked again and again";
  EXPECT_FALSE(std::filesystem::exists(path("s-2.h5")));
  const RecordingReader reader(path("s.h5"));
  double wanted_s = 0, given_up_s = 0;
  for (const recording::Event& event : reader.events()) {
    if (std::string(event.text.data()) == "another sample wanted: lets go") wanted_s = event.time_s;
    if (std::string(event.text.data()) == "another sample: no answer") given_up_s = event.time_s;
  }
  EXPECT_NEAR(given_up_s - wanted_s, 30, 1);
  EXPECT_GT(felt_about(path("s.h5"), "another sample wanted: lets go").before_n, 0.1);
}

// One address for the whole session: what it tells is of the sample that is felt.
TEST_F(ViewerSwitch, MetricsGoOnAtTheOtherSample) {
  if (const std::string no = missing({"/usr/bin/curl"}); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flakes"), 0, scene_flags({"flat_pdms", "flat_silicon_oxide"}));
  const auto user =
      person("--metrics 127.0.0.1:0 --server " + server.address(),
             "url=$(sed -n 's/^metrics at //p' err.txt)\n"
             "see 'Telenano: flat_silicon_oxide at'\n"
             "await '[ $(grep -c ^loop: err.txt) = 2 ]'; sleep 1\n"
             "curl -s --max-time 10 $url >first.txt; sleep 1; curl -s --max-time 10 $url >second.txt\n"
             "touch read\n");
  ASSERT_TRUE(appears("pressed")) << said();
  touch("choose");
  EXPECT_TRUE(appears("read")) << said();
  touch("go");
  ASSERT_TRUE(user->wait(2 * kLong)) << said();
  EXPECT_EQ(user->out(), "lives\nended with 0\n") << said();
  const auto ticks = [&](const std::string& file) {
    const std::string text = file_text(path(file));
    const auto at = text.find("\ntelenano_ticks_total ");
    return at == std::string::npos
               ? -1.0
               : std::atof(text.c_str() + at + std::string("\ntelenano_ticks_total ").size());
  };
  EXPECT_GT(ticks("first.txt"), 0) << file_text(path("first.txt"));
  EXPECT_GT(ticks("second.txt"), ticks("first.txt") + 100) << "the loop that runs now, not the one that was";
  EXPECT_EQ(RecordingReader(path("s-2.h5")).configuration("scene_name"), "flat_silicon_oxide");
}

// The disk of the recordings is slow: the first sample's takes five seconds to close, a server hears nothing for two
// and ends a session. The session must be tended meanwhile, or it is gone when the other sample begins.
TEST_F(ViewerSwitch, ARecordingThatTakesLongToCloseEndsNoSession) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  const std::string audit = path("audit.jsonl");
  std::vector<std::string> flags = scene_flags({"flat_pdms", "flat_silicon_oxide"});
  flags.insert(flags.end(), {"--timeout-ms", "2000", "--audit", audit});
  Server server(scene_path("flakes"), 0, flags);
  const auto user = person(
      "--server " + server.address(),
      "see 'Telenano: flat_silicon_oxide at'; await '[ $(grep -c ^loop: err.txt) = 2 ]'; touch there\n",
      std::string("LD_PRELOAD=") + TELENANO_SLOW_CLOSE_SHIM +
          " TELENANO_SLOW_CLOSE=/s.h5 TELENANO_SLOW_CLOSE_S=5");
  ASSERT_TRUE(appears("pressed")) << said();
  touch("choose");
  ASSERT_TRUE(appears("chosen")) << said();
  const auto chosen = std::chrono::steady_clock::now();
  EXPECT_TRUE(appears("there")) << said();
  EXPECT_GT(std::chrono::steady_clock::now() - chosen, Seconds(5)) << "or it was not slow";
  touch("go");
  ASSERT_TRUE(user->wait(2 * kLong)) << said();
  EXPECT_EQ(user->out(), "lives\nended with 0\n") << said();
  const std::string events = file_text(audit);
  EXPECT_NE(events.find("\"session opened\""), std::string::npos) << events;
  EXPECT_EQ(events.find("\"session silent\""), std::string::npos) << "nobody tended it:\n" << events;
  EXPECT_TRUE(RecordingReader(path("s.h5")).closed());
  EXPECT_EQ(RecordingReader(path("s-2.h5")).configuration("scene_name"), "flat_silicon_oxide");
}

// The hand presses, another sample is chosen, and the cable comes out while the force fades: motors at zero, both
// recordings whole, and a person can still end the session.
TEST_F(ViewerSwitch, ADeviceUnpluggedDuringTheSwitchIsAStopAndNoCrash) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  ::setenv("FDSDK", TELENANO_STANDIN_SDK, 1);
  support::StandinSdk sdk;
  sdk->buttons = 1;
  Server server(scene_path("flakes"), 0, scene_flags({"flat_pdms", "flat_silicon_oxide"}));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << kPerson << kMaster << " run --server " << server.address()
      << " --device omega --view --record s.h5 2>err.txt &\n"
         "master=$!\n"
         "see 'Telenano: flakes at'; await 'grep -q ^loop: err.txt'; touch pressed\n"
         "await '[ -e choose ]'\n"
         "xdotool mousemove 1115 704 click 1; sleep 2\n"
         "touch choosing; xdotool mousemove 1050 773 click 1; touch chosen\n"
         "await '[ -e go ]'\n"
         "kill -0 $master && echo lives\n"
         "press_until p '[ -s telenano-1.png ]'\n"
         "xdotool key ctrl+q; wait $master; echo ended with $?\n";
  // A hand without tasks has a lower list, which opens downwards.
  ChildProcess user({"/usr/bin/xvfb-run", "-a", "-s", "-screen 0 1280x800x24", "/bin/bash", path("user.sh")});
  ASSERT_TRUE(appears("pressed")) << said();
  const auto give_force_back =
      [&] {  // as a person does by the device's button, where this machine stood still
        if (sdk->force_off_cause != 3) return;
        sdk->watchdog_fired_ns = 0;
        sdk->force_off_cause = 0;
      };
  EXPECT_TRUE(wait_for(user, path("s.h5"), [&](const RecordingReader& reader) {
    give_force_back();
    const auto mode = reader.read("station_mode");
    return !mode.empty() && mode.back() == kEngaged;
  })) << said();
  touch("choose");
  ASSERT_TRUE(appears("choosing")) << said();
  // From the click to the other sample: somewhere in it.
  EXPECT_TRUE(wait_for_event(user, path("s.h5"), "another sample wanted: lets go")) << said();
  sdk->unplugged = 1;
  std::this_thread::sleep_for(Seconds(4));
  EXPECT_EQ(sdk.force_n(), 0);
  touch("go");
  ASSERT_TRUE(user.wait(2 * kLong)) << said();
  ::unsetenv("FDSDK");
  EXPECT_NE(user.out().find("lives\n"), std::string::npos) << user.out() << said();
  EXPECT_NE(user.out().find("ended with "), std::string::npos) << user.out();
  EXPECT_EQ(user.out().find("ended with 13"), std::string::npos) << "no signal: " << user.out() << said();
  keep_picture("unplugged");
  bool stopped = false;
  for (const std::string name : {"s.h5", "s-2.h5"}) {
    if (!std::filesystem::exists(path(name))) continue;
    const RecordingReader reader(path(name));
    EXPECT_TRUE(reader.closed()) << name;
    const auto mode = reader.read("station_mode");
    stopped |= std::find(mode.begin(), mode.end(), kStopped) != mode.end();
  }
  EXPECT_TRUE(stopped) << said();
  EXPECT_NE(said().find("unplugged"), std::string::npos) << said();
}

}  // namespace
}  // namespace telenano::programs

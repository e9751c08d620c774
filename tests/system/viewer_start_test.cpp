// The start screen under Xvfb: a session is chosen, begun and begun again; the minutes of a first visit.
#include "tests/system/viewer_programs.h"

namespace telenano::programs {
namespace {

// From the start screen into a session, out of it, and into the next one, by keyboard alone.
TEST_F(ViewerPrograms, ASessionIsChosenBegunAndBegunAgain) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_STATE_HOME=" << folder_.string() << "/state" << kPerson
      << kMaster << " start --server " << server.address()
      << " 2>err.txt &\n"
         "start=$!\n"
         "see 'Telenano: start, sim at .*, answered'\n"
         // From Start up to the recording's box.
         "xdotool key Up key space; see 'Telenano: start, sim, recording'; xdotool key Return\n"
         "see 'Telenano: flakes at'; await 'grep -q \" mJ \" err.txt'; press_until ctrl+q 'grep -q "
         "stopped.by.the.operator err.txt'\n"
         "see 'Telenano: start'; xdotool key Return\n"
         "see 'Telenano: flakes at'; await '[ -s session-2.h5 ]'; await '[ $(grep -c ^loop: err.txt) = 2 ]'\n"
         "told=$(grep -c ' mJ ' err.txt); await '[ $(grep -c \" mJ \" err.txt) -gt $told ]'\n"
         "kill $start; wait $start; echo ended with $?\n";
  const Finished user = before_a_screen(kLong);
  ASSERT_EQ(user.exit_code, 0) << user.err << user.out;
  EXPECT_EQ(user.out, "ended with 0\n") << file_text(path("err.txt"));
  EXPECT_EQ(file_text(path("state/telenano/servers")), server.address() + "\t\tflakes\n");
  for (const char* name : {"session.h5", "session-2.h5"}) {
    const recording::RecordingReader recording(path(name));
    EXPECT_TRUE(recording.closed()) << name << " of a session that the end of start ends too";
    EXPECT_GT(recording.rows(), 100u) << name;
  }
}

// Whatever is typed into the fields, each says in one line what is wrong with it, nothing typed is lost (the line counts
// 10 000 characters), and in the end a session begins.
TEST_F(ViewerPrograms, NonsenseInEveryFieldIsToldThereAndCanBeCorrected) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flat_silicon_oxide"));
  std::ofstream(path("here.key")) << "no key";
  std::filesystem::permissions(path("here.key"), std::filesystem::perms(0644));
  std::filesystem::create_directory(path("folder"));
  std::ofstream(path("user.sh")) << "cd " << folder_.string()
                                 << "\nexport XDG_STATE_HOME=" << folder_.string()
                                 << "/state\nserver=" << server.address() << "\nmaster=" << kMaster << kPerson
                                 << R"sh(
# The text of the field that is written in, and what the title then says of it. A screen that draws slowly takes the letters
# of a picture before its keys: Ctrl+A has one of its own.
field() {
  xdotool key ctrl+a; sleep 0.15; xdotool key BackSpace; sleep 0.15
  [ -z "$1" ] || xdotool type --delay 1 -- "$1"
  see "Telenano: start, sim, recording at .*$2"
}
next() { xdotool key Tab; sleep 0.2; }
many=$(printf 'w%.0s' $(seq 10000))
long=$(printf 'w%.0s' $(seq 4200))
$master start --server $server 2>err.txt &
start=$!
see 'Telenano: start, sim at .*, answered'
xdotool key Up key space; see 'Telenano: start, sim, recording'
xdotool mousemove 420 58 click 1; sleep 0.2
field '' 'Server: Name a server'
field lab 'Server: The server needs its port'
field lab:0 'Server: Port .0. is not'
field lab:99999 'Server: Port .99999. is not a number from 1 to 65535'
field ::1:5100 'Server: An IPv6 address needs brackets'
field '[::1' 'Server: The IPv6 address needs its closing bracket'
field '/tmp/lab 1:5100' 'Server: .* is no host'
field "$many" 'Server: At most 4095 characters, these are 10000$'
field '[::1]:5100' '\[::1\]:5100$'
field $server "$server"; xdotool key Return; see "Telenano: start, sim, recording at $server, answered"
xdotool mousemove 420 58 click 1; sleep 0.2; next
field none.key 'Key file: There is no such file'
field folder 'Key file: This is a folder'
field "$long" 'Key file: .*this one has 4200$'
field here.key "$server$"; xdotool key Return
see 'Key file: key file here.key: holds a secret but its mode 0644'
xdotool mousemove 420 58 click 1; sleep 0.2; next
field '' "$server"; next
field folder 'Identity: This is a folder'
field here.key 'Server.s key: Name the server.s key too'; next
field sha256:ab 'Server.s key: Expected sha256: and 64'
field '' 'Server.s key: Name the server'
xdotool key shift+Tab; sleep 0.2; field '' "$server"; next
field folder 'Recording: This is a folder'
field none/a.h5 'Recording: There is no such folder'
field here.key 'Recording: This file exists already'
field "$long" 'Recording: .*this one has 4200$'
field ok.h5 "$server"
kill -0 $start && echo lives
xdotool key Return; sleep 0.3; xdotool key Return
see 'Telenano: flat_silicon_oxide at'; await 'grep -q " mJ " err.txt'
press_until ctrl+q 'grep -q stopped.by.the.operator err.txt'
see 'Telenano: start, sim, recording'; kill $start; wait $start; echo ended with $?
)sh";
  const Finished user = before_a_screen(4 * kLong);
  EXPECT_EQ(user.out, "lives\nended with 0\n") << user.err << file_text(path("err.txt"));
  EXPECT_TRUE(recording::RecordingReader(path("ok.h5")).closed());
}

// Another sample is another server: the list of those seen lately says which has which, and a choice of it and
// Enter begin the next session there.
TEST_F(ViewerPrograms, AnotherSceneIsChosenOnTheStartScreen) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server flakes(scene_path("flakes"));
  Server flat(scene_path("flat_silicon_oxide"));
  std::filesystem::create_directories(path("state/telenano"));
  std::ofstream(path("state/telenano/servers")) << flat.address() << "\t\tflat_silicon_oxide\n";
  // The list stands above the hands: the first row from the top that makes the server another one. A row in
  // small steps, since the summary of the session before stands over it.
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_STATE_HOME=" << folder_.string() << "/state" << kPerson
      << "choose() { for y in $(seq 60 6 500); do xdotool search --name \"start, .* at $1\" >/dev/null && "
         "return\n"
         "xdotool mousemove 420 $y click 1; sleep 0.2; done; echo \"no: $1\"; }\n"
      << kMaster << " start --server " << flakes.address() << " 2>err.txt &\n"
      << "start=$!\n"
         "see 'Telenano: start, sim at .*, answered'; xdotool key Return\n"
         "see 'Telenano: flakes at'; await 'grep -q \" mJ \" err.txt'; press_until ctrl+q 'grep -q "
         "stopped.by.the.operator err.txt'\n"
         "see 'Telenano: start'; choose "
      << flat.address()
      << "\n"
         "see 'Telenano: start, .*, answered'; xdotool key Return; see 'Telenano: flat_silicon_oxide at'\n"
         "await '[ $(grep -c ^loop: err.txt) = 2 ]'; kill $start; wait $start; echo ended with $?\n";
  const Finished user = before_a_screen(4 * kLong);
  EXPECT_EQ(user.out, "ended with 0\n") << user.err << file_text(path("err.txt"));
  // Newest first.
  EXPECT_EQ(file_text(path("state/telenano/servers")),
            flat.address() + "\t\tflat_silicon_oxide\n" + flakes.address() + "\t\tflakes\n");
}

// Over a round trip of 20 ms, where nothing was kept: the window is open and has the server's own surface
// before the twin of it is ready, which takes seconds. The bound in seconds is loose, for a busy machine.
TEST_F(ViewerPrograms, TheSampleIsSeenBeforeItsTwinIsReady) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flakes"));
  ChildProcess relay(
      {kLab, "relay", "--listen", "127.0.0.1:0", "--to", server.address(), "--delay-ms", "10"});
  const std::string before_port = "relay on 127.0.0.1:";
  ASSERT_TRUE(relay.wait_for_err(before_port, kLong) && relay.wait_for_err("\n", kLong)) << relay.err();
  const std::string said = relay.err();
  const int relayed = std::atoi(said.c_str() + said.find(before_port) + before_port.size());
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_CACHE_HOME=" << folder_.string() << "/cache" << kPerson
      << kMaster << " run --server 127.0.0.1:" << relayed << " --method twin --view 2>err.txt &\n"
      << "master=$!\n"
         "see 'Telenano: getting ready, the sample is drawn'; grep -c ^loop: err.txt\n"
         "see 'Telenano: flakes at'; await 'grep -q ^loop: err.txt'; press_until ctrl+q '! kill -0 $master "
         "2>/dev/null'\n"
         "wait $master; echo ended with $?\n";
  const Finished user = before_a_screen(4 * kLong);
  const std::string told = file_text(path("err.txt"));
  EXPECT_EQ(user.out, "0\nended with 0\n") << user.err << told;
  const std::string before = "the sample seen after ";
  const auto at = told.find(before);
  ASSERT_NE(at, std::string::npos) << told;
  EXPECT_LT(std::strtod(told.c_str() + at + before.size(), nullptr), 10) << told;
  relay.signal(SIGTERM);
}

// While it gets ready, as later.
TEST_F(ViewerPrograms, AWindowThatGetsReadyCanBeLeft) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_CACHE_HOME=" << folder_.string() << "/cache" << kPerson
      << kMaster << " run --server " << server.address() << " --method twin --view 2>err.txt &\n"
      << "master=$!\n"
         "see 'Telenano: getting ready'; press_until ctrl+q '! kill -0 $master 2>/dev/null'\n"
         "wait $master; echo ended with $?\n";
  const Finished user = before_a_screen(4 * kLong);
  EXPECT_EQ(user.out, "ended with 0\n") << user.err << file_text(path("err.txt"));
  EXPECT_NE(file_text(path("err.txt")).find("stopped by the operator"), std::string::npos);
}

// Who has never been here: the window opens, two clicks choose and begin (the server answers by itself), and
// one drag down and up ends with a pull-off. Eight clicks are allowed: where the machine is so busy that the server
// has withdrawn the tip before the session began, the mouse takes hold more than once, as the window says.
TEST_F(ViewerPrograms, FromTheOpenedWindowToAPullOffInFewClicks) {
  if (const std::string no = missing(); !no.empty()) GTEST_SKIP() << no;
  Server server(scene_path("flakes"));
  std::ofstream(path("user.sh"))
      << "cd " << folder_.string() << "\nexport XDG_STATE_HOME=" << folder_.string() << "/state" << kPerson
      << "click() { xdotool mousemove $1 $2 click 1; echo click; }\n"
      << kMaster << " start --server " << server.address()
      << " 2>err.txt &\n"
         "start=$!\n"
         "see 'Telenano: start, sim at .*, answered'\n"
         // A recording to look into, by key, since where its box stands depends on the devices that are here.
         "xdotool key Up key space; see 'Telenano: start, sim, recording'\n"
         // The mouse as hand; Start.
         "click 323 170; see 'Telenano: start, mouse'\n"
         // As a person does: again, where nothing has come of it for a quarter of a minute.
         "for n in 1 2 3; do click 300 764; for i in $(seq 60); do\n"
         "xdotool search --name 'Telenano: start' >/dev/null || break 2; sleep 0.25; done; done\n"
         "see 'Telenano: flakes at'; await 'grep -q ^loop: err.txt'\n"
         "lead 'above \"$(told force)\" 1' 150 4\n"
         "press_until p '[ -s telenano-1.png ]'\n"
         "lead 'above \"$(told tip)\" 5 || ! drag 5 -4' 580 -4 held\n"
         "press_until p '[ -s telenano-2.png ]'\n"
         "xdotool mouseup 1 key n; see 'Telenano: .*, writing a note'\n"
         "xdotool type --delay 60 'it held on; lets go'; xdotool key Return\n"
         "press_until ctrl+q 'grep -q stopped.by.the.operator err.txt'\n"
         "kill $start; wait $start; echo ended with $?\n";
  const Finished user = before_a_screen(4 * kLong);
  ASSERT_EQ(user.exit_code, 0) << user.err << user.out << file_text(path("err.txt"));
  const std::vector<std::string> lines = lines_of(user.out);
  const auto clicks = std::count(lines.begin(), lines.end(), "click");
  EXPECT_GE(clicks, 3);
  EXPECT_LE(clicks, 8) << user.out << file_text(path("err.txt"));
  ASSERT_EQ(lines.size(), static_cast<std::size_t>(clicks) + 1) << user.out << file_text(path("err.txt"));
  EXPECT_EQ(lines.back(), "ended with 0") << file_text(path("err.txt"));
  // By the summary the tip was in contact and held on; by the rows it then came free.
  const std::string told = file_text(path("err.txt"));
  EXPECT_EQ(told.find("pull-off force                       0.00"), std::string::npos) << told;
  const recording::RecordingReader recording(path("session.h5"));
  std::string notes;
  for (const recording::Event& event : recording.events()) {
    const std::string text(event.text.data());
    if (text.starts_with("note: ")) notes += text + "|";
  }
  EXPECT_EQ(notes, "note: it held on; lets go|");
  const auto contact = recording.read("contact_state");
  const auto force = recording.read("force_w_nn", 2);
  const auto touched = std::find(contact.rbegin(), contact.rend(), 3.0);
  ASSERT_NE(touched, contact.rend()) << "no contact";
  const auto left = static_cast<std::size_t>(touched.base() - contact.begin());
  EXPECT_LT(left, contact.size()) << "never let go";
  EXPECT_LT(*std::min_element(force.begin(), force.begin() + static_cast<std::ptrdiff_t>(left)), -5);
  if (const char* look = std::getenv("TELENANO_LOOK")) {
    for (const char* name : {"telenano-1.png", "telenano-2.png"})
      std::filesystem::copy_file(path(name), std::string(look) + "/" + name,
                                 std::filesystem::copy_options::overwrite_existing);
  }
}

TEST_F(ViewerPrograms, AStartWithoutADisplayIsRefused) {
  const Finished refused = run_program(without_display({kMaster, "start"}));
  EXPECT_EQ(refused.exit_code, 2);
  EXPECT_NE(refused.err.find("there is no display"), std::string::npos) << refused.err;
  EXPECT_EQ(lines_of(refused.err).size(), 1u) << refused.err;
}

}  // namespace
}  // namespace telenano::programs

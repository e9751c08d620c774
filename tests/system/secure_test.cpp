// Encrypted sessions between the two programs, and what a person is told who gets keys or certificates wrong.
#include <sys/stat.h>

#include <regex>
#include <thread>

#include "telenano/common/net/udp.h"
#include "telenano/common/recording/recording_reader.h"
#include "tests/system/felt_force.h"
#include "tests/system/programs.h"
#include "tests/system/recorded.h"

namespace telenano::programs {
namespace {

using recording::RecordingReader;

class SecureTest : public ProgramsTest {
 protected:
  void SetUp() override {
    ProgramsTest::SetUp();
    if (TELENANO_WITH_DTLS == 0) GTEST_SKIP() << "built without TELENANO_DTLS";
    make_key("omega-1");
  }
  std::string keys() const { return path("keys.toml"); }
  std::string make_key(const std::string& name, const std::string& rights = "operate") const {
    const std::string file = path(name + ".key");
    const Finished made =
        run_program({kNve, "keys", "new", name, "--rights", rights, "--keys", keys(), "--out", file});
    EXPECT_EQ(made.exit_code, 0) << made.err;
    EXPECT_EQ(made.out, "");
    return file;
  }
  Finished session(const Server& server, const std::vector<std::string>& more) const {
    std::vector<std::string> command = station(server, {"--duration-s", "1", "--task", "contact"});
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command, {}, kLong);
  }
  /// A station with the key that says how far it is. It presses on the sample from 0.4 to 0.75 of its time.
  std::vector<std::string> talking(const Server& server, const std::vector<std::string>& more) const {
    std::vector<std::string> command{
        kMaster,         "run", "--server",         server.address(), "--task", "contact",
        "--rt-priority", "0",   "--velocity-scale", "4e-6",           "--key",  path("omega-1.key")};
    command.insert(command.end(), more.begin(), more.end());
    return command;
  }
  /// The hand was pressed, from nothing on, and never faster than the slew limit of 4000 N/s lets the force
  /// rise in a tick. On a busy machine the first tick may have a reply already, of what measured the link before
  /// it: then the ramp of 200 ticks begins there.
  static void expect_no_step(const std::string& file) {
    const FeltForce felt = felt_force(file);
    EXPECT_LE(felt.first_n, felt.most_n / 100) << file;
    EXPECT_GT(felt.most_n, 0.1) << file;
    EXPECT_LE(felt.most_rise_n, 4 * (1 + 1e-9)) << file;
  }
  static bool lost_its_session(const std::string& file) {
    const auto events = RecordingReader(file).events();
    return std::any_of(events.begin(), events.end(), [](const recording::Event& event) {
      return std::string(event.text.data()).find("server silent") != std::string::npos;
    });
  }
  /// One line, exit code 1, that names all of these.
  static void expect_failed(const Finished& run, const std::vector<std::string>& named) {
    EXPECT_EQ(run.exit_code, 1) << run.err;
    EXPECT_EQ(run.out, "");
    EXPECT_EQ(lines_of(run.err).size(), 1u) << run.err;
    for (const auto& word : named)
      EXPECT_NE(run.err.find(word), std::string::npos) << word << "\n" << run.err;
  }
  /// The secret of a key file, which nobody may print.
  static std::string secret_of(const std::string& file) {
    const std::string text = file_text(file);
    const auto at = text.find("psk = \"");
    EXPECT_NE(at, std::string::npos);
    return text.substr(at + 7, 64);
  }
};

TEST_F(SecureTest, AServerOnEveryAddressAnswersFromTheOneThatWasAsked) {
  // 127.0.0.2 is this machine's too, but what is sent to 127.0.0.1 leaves from there if nobody says
  // otherwise.
  for (const auto& [listen, more] : std::vector<std::pair<std::string, std::vector<std::string>>>{
           {"0.0.0.0:0", {}}, {"0.0.0.0:0", {"--busy-poll"}}, {"[::]:0", {}}}) {
    std::vector<std::string> command{kNve,       "serve", "--scene", scene_path("flat_silicon_oxide"),
                                     "--listen", listen,  "--keys",  keys()};
    command.insert(command.end(), more.begin(), more.end());
    ChildProcess server(command);
    if (!server.wait_for_err("serving", kLong) && listen == "[::]:0") continue;  // no IPv6 here
    ASSERT_TRUE(server.wait_for_err(", encrypted", kLong)) << server.err();
    std::smatch match;
    const std::string said = server.err();
    ASSERT_TRUE(std::regex_search(said, match, std::regex("(0\\.0\\.0\\.0|\\[::\\]):(\\d+), encrypted")))
        << said;
    for (const char* const host : {"127.0.0.1", "127.0.0.2", "127.1.2.3"}) {
      const Finished done = run_program(
          {kMaster, "run", "--quiet", "--server", std::string(host) + ":" + match[2].str(), "--key",
           path("omega-1.key"), "--task", "contact", "--duration-s", "0.5", "--give-up-s", "2"},
          {}, kLong);
      EXPECT_EQ(done.exit_code, 0) << listen << " asked at " << host << ": " << done.err;
    }
    server.signal(SIGTERM);
    ASSERT_TRUE(server.wait(kLong));
    EXPECT_EQ(server.exit_code(), 0) << server.err();
  }
}

TEST_F(SecureTest, ASessionRunsAndIsRecordedAsEncrypted) {
  Server server(scene_path("flakes"), 0, {"--keys", keys()});
  const std::string file = path("secure.h5");
  const Finished run = session(server, {"--key", path("omega-1.key"), "--record", file});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const std::string said = server.stop();
  EXPECT_NE(said.find("encrypted"), std::string::npos);
  EXPECT_NE(said.find("in 1 sessions"), std::string::npos) << said;
  EXPECT_NE(said.find("handshakes 1"), std::string::npos) << said;
  EXPECT_NE(said.find("closed 1"), std::string::npos) << said;  // the station said goodbye
  const std::string secret = secret_of(path("omega-1.key"));
  for (const std::string& text : {said, run.err, run.out, file_text(file)})
    EXPECT_EQ(text.find(secret), std::string::npos);
  EXPECT_NE(file_text(file).find("DTLS 1.2, key omega-1"), std::string::npos);
  EXPECT_GT(RecordingReader(file).rows(), 900u);
}

TEST_F(SecureTest, EveryAddressIsServedWithKeys) {
  ChildProcess server(
      {kNve, "serve", "--scene", scene_path("flat_pdms"), "--listen", ":0", "--keys", folder_.string()});
  const std::string before = " on 0.0.0.0:";
  ASSERT_TRUE(server.wait_for_err(", encrypted\n", kLong)) << server.err();
  const std::string text = server.err();
  const std::string port = std::to_string(std::atoi(text.c_str() + text.find(before) + before.size()));
  const Finished run = run_program({kMaster, "run", "--quiet", "--server", "127.0.0.1:" + port,
                                    "--duration-s", "1", "--task", "contact", "--key", path("omega-1.key")},
                                   {}, kLong);
  EXPECT_EQ(run.exit_code, 0) << run.err;
}

TEST_F(SecureTest, AnObserverFeelsNothingAndMovesNothing) {
  const std::string key = make_key("guest", "observe");
  Server server(scene_path("flakes"), 0, {"--keys", keys()});
  const std::string file = path("observer.h5");
  const Finished run = session(server, {"--key", key, "--record", file});
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const RecordingReader reader(file);
  double lowest = 1e300, highest = -1e300;
  for (const double z : reader.read("tip_pos_w_nm", 2)) {
    if (z == 0) continue;  // no reply yet
    lowest = std::min(lowest, z);
    highest = std::max(highest, z);
  }
  EXPECT_LT(highest - lowest, 1e-6) << "the tip moved";
}

/// The number behind the last `word`, -1 if there is none. A machine that stalls for longer than a session's
/// time-out makes sessions resume once more than the test does: that is no fault.
int number_behind(const std::string& text, const std::string& word) {
  const std::size_t at = text.rfind(word);
  return at == std::string::npos ? -1 : std::atoi(text.c_str() + at + word.size());
}

// In contact, by kill -9 and in order. The station agrees on a new channel and a new session by itself.
TEST_F(SecureTest, AServerThatEndsAndStartsAgainIsFoundWithoutAStepOfTheForce) {
  for (const int signal : {SIGKILL, SIGTERM}) {
    auto first =
        std::make_unique<Server>(scene_path("flat_pdms"), 0, std::vector<std::string>{"--keys", keys()});
    const int port = first->port();
    const std::string file = path("again" + std::to_string(signal) + ".h5");
    ChildProcess run(talking(*first, {"--duration-s", "10", "--record", file}));
    ASSERT_TRUE(wait_for_contact(run, file));
    first->child().signal(signal);
    ASSERT_TRUE(first->child().wait(kLong));
    Server second(scene_path("flat_pdms"), port, {"--keys", keys()});
    ASSERT_TRUE(run.wait(kLong)) << run.err();
    EXPECT_EQ(run.exit_code(), 0) << run.err();
    const std::string said = second.stop();
    EXPECT_GE(number_behind(said, "exchanges in "), 1) << said;
    EXPECT_GE(number_behind(said, "handshakes "), 1) << said;
    expect_no_step(file);
    std::size_t new_epochs = 0;
    for (const recording::Event& event : RecordingReader(file).events())
      new_epochs += std::string(event.text.data()).find("new epoch") != std::string::npos ? 1 : 0;
    EXPECT_GE(new_epochs, 1u);
  }
}

// kill -9 of the station in contact: it begins a new session beside what is left, over a new channel, and the force
// comes in by the ramp.
TEST_F(SecureTest, AStationThatIsKilledComesBackWithItsKeyWithoutAStepOfTheForce) {
  Server server(scene_path("flat_pdms"), 0, {"--keys", keys()});
  const auto command = [&](const std::string& duration_s, const std::string& record) {
    return talking(server, {"--duration-s", duration_s, "--record", record});
  };
  ChildProcess killed(command("5", path("killed.h5")));
  ASSERT_TRUE(killed.wait_for_err("engaged", kLong)) << killed.err();
  std::this_thread::sleep_for(Milliseconds(2500));
  killed.signal(SIGKILL);
  ASSERT_TRUE(killed.wait(kLong));
  const std::string file = path("anew.h5");
  Finished again = run_program(command("6", file), {}, kLong);
  // A machine that stops a station on its way down makes it lose the session: it goes on from where its hand then
  // is, and does not come down to the sample. That is another story, so it comes back once more.
  for (int more = 0;
       more < 3 && again.exit_code == 0 && felt_force(file).most_n <= 0.1 && lost_its_session(file); ++more) {
    std::filesystem::remove(file);
    again = run_program(command("6", file), {}, kLong);
  }
  EXPECT_EQ(again.exit_code, 0) << again.err;
  expect_no_step(file);
  const std::string said = server.stop();
  EXPECT_GE(number_behind(said, "exchanges in "), 2) << said;
  EXPECT_GE(number_behind(said, "handshakes "), 2) << said;
}

TEST_F(SecureTest, RevokingAKeyEndsItsSession) {
  make_key("stays");
  Server server(scene_path("flakes"), 0, {"--keys", keys()});
  const std::string file = path("revoked.h5");
  ChildProcess run(station(server, {"--duration-s", "30", "--task", "contact", "--key", path("omega-1.key"),
                                    "--give-up-s", "1", "--record", file}));
  ASSERT_TRUE(wait_for(run, file, [](const RecordingReader& reader) { return reader.rows() > 100; }));
  EXPECT_EQ(run_program({kNve, "keys", "revoke", "omega-1", "--keys", keys()}).exit_code, 0);
  ASSERT_TRUE(run.wait(std::chrono::seconds(10))) << run.err();
  EXPECT_EQ(run.exit_code(), 1);
  EXPECT_NE(run.err().find("has been silent for 1 s"), std::string::npos) << run.err();
  EXPECT_NE(run.err().find("does not know the key 'omega-1'"), std::string::npos) << run.err();
  expect_failed(session(server, {"--key", path("omega-1.key")}), {"does not know the key 'omega-1'"});
  EXPECT_EQ(session(server, {"--key", path("stays.key")}).exit_code, 0);
  // A list that nobody can read changes nothing, but is told.
  ::chmod(keys().c_str(), 0644);
  ASSERT_TRUE(server.child().wait_for_err("chmod 600", kLong));
  EXPECT_EQ(session(server, {"--key", path("stays.key")}).exit_code, 0);
  const std::string said = server.stop();
  EXPECT_NE(said.find("revoked 1"), std::string::npos) << said;
}

// Ten seconds are enough to begin, in which its session goes on, and no longer.
TEST_F(SecureTest, AKeyThatExpiresEndsItsSessionAndTheOneThatFollowsOpensTheNext) {
  const auto begin = std::chrono::system_clock::now();
  EXPECT_EQ(run_program({kNve, "keys", "rotate", "omega-1", "--keys", keys(), "--out", path("next.key"),
                         "--overlap-days", std::to_string(10.0 / 86400)})
                .exit_code,
            0);
  Server server(scene_path("flat_pdms"), 0, {"--keys", keys()});
  const std::string file = path("expires.h5");
  ChildProcess run(station(server, {"--duration-s", "60", "--task", "contact", "--key", path("omega-1.key"),
                                    "--give-up-s", "1", "--record", file}));
  ASSERT_TRUE(wait_for(run, file, [](const RecordingReader& reader) { return reader.rows() > 100; }));
  ASSERT_TRUE(run.wait(kLong)) << run.err();
  EXPECT_GE(std::chrono::system_clock::now() - begin, std::chrono::seconds(9));
  EXPECT_EQ(run.exit_code(), 1);
  EXPECT_NE(run.err().find("does not know the key 'omega-1'"), std::string::npos) << run.err();
  EXPECT_NE(run.err().find("what has expired"), std::string::npos) << run.err();
  EXPECT_EQ(session(server, {"--key", path("next.key")}).exit_code, 0);
  const std::string said = server.stop();
  EXPECT_NE(said.find("'omega-1' expires at"), std::string::npos) << said;
  EXPECT_NE(said.find("'omega-1' has expired"), std::string::npos) << said;
}

TEST_F(SecureTest, WhatAPersonGetsWrongIsToldInOneLine) {
  Server server(scene_path("flat_pdms"), 0, {"--keys", keys()});
  Server plain(scene_path("flat_pdms"));
  const std::string text = file_text(path("omega-1.key"));
  const auto key_file = [&](const std::string& name, const std::string& from, const std::string& to) {
    std::string changed = text;
    changed.replace(changed.find(from), from.size(), to);
    const std::string file = write(name, changed);
    ::chmod(file.c_str(), 0600);
    return file;
  };
  const std::string secret = secret_of(path("omega-1.key"));
  expect_failed(session(server, {"--key", key_file("other.key", "omega-1", "omega-7")}),
                {server.address(), "does not know the key 'omega-7'", "keys list"});
  expect_failed(session(server, {"--key", key_file("wrong.key", secret, std::string(64, 'a'))}),
                {server.address(), "most likely the key 'omega-1' is not the one"});
  expect_failed(session(server, {"--connect-timeout-s", "1"}), {server.address(), "--key"});
  expect_failed(session(plain, {"--key", path("omega-1.key"), "--connect-timeout-s", "1"}),
                {plain.address(), "--keys"});
  EXPECT_NE(server.stop().find("unknown keys 1"), std::string::npos);
  expect_failed(session(server, {"--key", path("omega-1.key"), "--connect-timeout-s", "1"}),
                {server.address(), "nothing listens on UDP port"});
}

TEST_F(SecureTest, AServerOfAnOlderDtlsIsTold) {
  if (run_program({"/bin/sh", "-c", "command -v openssl"}).exit_code != 0)
    GTEST_SKIP() << "no openssl program to be one";
  const std::string address = net::to_string(
      net::Udp::listen(net::parse_address("127.0.0.1:0", "test")).local());  // free a moment ago
  const ChildProcess old({"/bin/sh", "-c",
                          "exec openssl s_server -dtls1 -psk " + secret_of(path("omega-1.key")) +
                              " -psk_identity omega-1 -nocert -accept " + address +
                              " -cipher 'PSK:@SECLEVEL=0' -quiet </dev/zero >/dev/null 2>&1"});
  expect_failed(run_program({kMaster, "run", "--server", address, "--key", path("omega-1.key"),
                             "--connect-timeout-s", "20"},
                            {}, kLong),
                {address, "DTLS 1.2"});
}

TEST_F(SecureTest, CertificatesFromTheCommandLine) {
  if (run_program({"/bin/sh", "-c", "command -v openssl"}).exit_code != 0)
    GTEST_SKIP() << "no openssl program to make them";
  const std::string script =
      "set -e; umask 077; ec='-newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes'; "
      "openssl req -x509 $ec -keyout ca.key -out ca.pem -subj /CN=lab -days 2; "
      "make() { openssl req $ec -keyout $1.key -out $1.csr -subj /CN=$1; "
      "printf '%s' \"$2\" > $1.ext; openssl x509 -req -in $1.csr -CA ca.pem -CAkey ca.key -CAcreateserial "
      "-days 2 "
      "-extfile $1.ext -out $1.pem; }; "
      "make nve subjectAltName=IP:127.0.0.1; make omega-3 ''; make stranger ''; "
      "old='openssl x509 -req -in omega-3.csr -CA ca.pem -CAkey ca.key -CAcreateserial -out old.pem'; "
      // OpenSSL 3.4 and later make none that ends before it begins, and are told both; 3.0 knows days alone.
      "$old -days -1 || $old -not_before 20200101000000Z -not_after 20200102000000Z; "
      "cp omega-3.key old.key";
  ChildOptions here;
  here.folder = folder_;
  const Finished made = run_program({"/bin/sh", "-c", script}, here);
  ASSERT_EQ(made.exit_code, 0) << made.err;
  write("list.toml", "[[certificate]]\nname = \"omega-3\"\nrights = \"operate\"\n");
  ::chmod(path("list.toml").c_str(), 0600);
  Server server(scene_path("flat_pdms"), 0,
                {"--keys", path("list.toml"), "--cert", path("nve.pem"), "--cert-key", path("nve.key"),
                 "--ca", path("ca.pem")});
  const auto as = [&](const std::string& name) {
    return session(
        server, {"--cert", path(name + ".pem"), "--cert-key", path(name + ".key"), "--ca", path("ca.pem")});
  };
  EXPECT_EQ(as("omega-3").exit_code, 0);
  expect_failed(as("stranger"),
                {"the server refuses the certificate", "stranger.pem", "not in the server's list"});
  expect_failed(session(server, {"--cert", path("omega-3.pem"), "--cert-key", path("omega-3.key"), "--ca",
                                 path("stranger.pem")}),
                {"signed by none of --ca"});
  // Expired: told before anything is sent, whoever it is.
  const Finished old =
      session(server, {"--cert", path("old.pem"), "--cert-key", path("old.key"), "--ca", path("ca.pem")});
  EXPECT_EQ(old.exit_code, 2);
  EXPECT_EQ(lines_of(old.err).size(), 1u) << old.err;
  for (const char* word : {"old.pem", "expired"}) EXPECT_NE(old.err.find(word), std::string::npos) << old.err;
  const Finished old_server = run_program(
      {kNve, "serve", "--scene", scene_path("flat_pdms"), "--listen", "127.0.0.1:0", "--keys",
       path("list.toml"), "--cert", path("old.pem"), "--cert-key", path("old.key"), "--ca", path("ca.pem")},
      {}, kLong);
  EXPECT_EQ(old_server.exit_code, 2);
  EXPECT_EQ(lines_of(old_server.err).size(), 1u) << old_server.err;
  EXPECT_NE(old_server.err.find("expired"), std::string::npos) << old_server.err;
  EXPECT_NE(server.stop().find("refused certificates 1"), std::string::npos);
}

TEST_F(SecureTest, FlagsThatDoNotGoTogether) {
  const std::string scene = scene_path("flat_pdms");
  const std::vector<std::string> serve{kNve, "serve", "--scene", scene, "--listen", "127.0.0.1:0"};
  const std::vector<std::string> run{kMaster, "run", "--server", "127.0.0.1:9"};
  const std::string open = write("open.toml", file_text(keys()));
  ::chmod(open.c_str(), 0644);
  const std::string empty = write("empty.toml", "");
  ::chmod(empty.c_str(), 0600);
  const struct {
    std::vector<std::string> command, more, named;
  } all[] = {
      {serve, {"--insecure", "--keys", keys()}, {"--insecure", "--keys"}},
      {{kNve, "serve", "--scene", scene, "--listen", ":0"},
       {"--insecure"},
       {"--insecure", "only on loopback"}},
      {{kNve, "serve", "--scene", scene, "--listen", "192.0.2.77:5100"},
       {"--keys", keys()},
       {"192.0.2.77", "this machine"}},
      {serve, {"--cert", "a"}, {"--cert-key", "--ca", "--keys"}},
      {serve, {"--keys", keys(), "--ca", "a"}, {"--cert-key", "--ca"}},
      {serve, {"--keys", "none.toml"}, {"none.toml", "No such file"}},
      {serve, {"--keys", open}, {open, "chmod 600"}},
      {serve, {"--keys", empty}, {empty, "empty", "keys new"}},
      {serve, {"--keys", keys(), "--cert", "a", "--cert-key", "b", "--ca", "c"}, {"--cert a", "PEM"}},
      {run, {"--key", "none.key"}, {"none.key", "No such file"}},
      {run, {"--key", open}, {open, "chmod 600"}},
      {run, {"--key", keys()}, {keys(), "identity"}},
      {run,
       {"--key", path("omega-1.key"), "--cert", "a", "--cert-key", "b", "--ca", "c"},
       {"--key", "--cert"}},
      {run, {"--cert", "a"}, {"--cert-key", "--ca"}},
      {run, {"--cert", "a", "--cert-key", "b", "--ca", "c"}, {"--cert a"}},
      {{kNve, "keys"}, {}, {"new, rotate, add, identity, list or revoke"}},
      {{kNve, "keys"}, {"nwe"}, {"'nwe'", "did you mean new?"}},
      {{kNve, "keys", "new"}, {}, {"name"}},
      {{kNve, "keys", "new"},
       {"x", "--keys", keys(), "--right", "observe"},
       {"--right", "did you mean --rights?"}},
      {{kNve, "keys", "new"}, {"x", "--keys", keys(), "--rights", "all"}, {"--rights", "all"}},
      {{kNve, "keys", "new"}, {"omega-1", "--keys", keys()}, {"omega-1", "already"}},
      {{kNve, "keys", "new"}, {"x y", "--keys", keys()}, {"'x y'"}},
      {{kNve, "keys", "revoke"}, {"omega-2", "--keys", keys()}, {"omega-2"}},
      {{kNve, "keys", "rotate"}, {"omega-2", "--keys", keys()}, {"omega-2", "omega-1"}},
      {{kNve, "keys", "new"}, {"x", "--keys", keys(), "--days", "0"}, {"--days"}},
      {{kNve, "keys", "list"}, {"--keys", "none.toml"}, {"none.toml"}},
  };
  for (const auto& bad : all) {
    std::vector<std::string> command = bad.command;
    command.insert(command.end(), bad.more.begin(), bad.more.end());
    const Finished run_of = run_program(command, {}, kLong);
    EXPECT_EQ(run_of.exit_code, 2) << run_of.err;
    EXPECT_EQ(run_of.out, "");
    EXPECT_EQ(lines_of(run_of.err).size(), 1u) << run_of.err;
    for (const auto& word : bad.named)
      EXPECT_NE(run_of.err.find(word), std::string::npos) << word << "\n" << run_of.err;
  }
  const Finished list = run_program({kNve, "keys", "list", "--keys", keys()});
  EXPECT_EQ(list.exit_code, 0);
  EXPECT_EQ(list.out, "kind,identity,rights,expires\npsk,omega-1,operate,\n");
  const Finished insecure =
      run_program({kNve, "serve", "--scene", "none.toml", "--listen", "127.0.0.1:0", "--insecure"});
  EXPECT_NE(insecure.err.find("none.toml"), std::string::npos) << "accepted on loopback";
}

}  // namespace
}  // namespace telenano::programs

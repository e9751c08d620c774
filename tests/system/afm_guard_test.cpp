// A server with an AFM that is killed, hangs or stands still, by the real programs: the tip is withdrawn, by the
// guard, and stays so.
#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "telenano/common/net/tcp.h"
#include "telenano/common/net/udp.h"
#include "tests/system/afm_programs.h"

namespace telenano::programs {
namespace {

TEST_F(AfmProgramsTest, AServerThatIsKilledLeavesTheTipWithdrawn) {
  Simulator simulator;
  ChildProcess server(serve(simulator.ports(), afm()));
  ASSERT_GT(port_of(server), 0);
  const pid_t guard = guard_of(server);
  ASSERT_GT(guard, 0);
  server.signal(SIGKILL);
  ASSERT_TRUE(server.wait(kLong));
  EXPECT_TRUE(ends(guard));
  const std::string end = simulator.stop();
  EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
}

// A server that hangs keeps its end of the guard's stream open: only the missing heart beat tells. The
// guard's patience is four reply times: here 8 s, since less would be too little for the checks under a
// sanitizer, or for a machine that keeps the simulator waiting. The way up took more than 1.5 s on a busy machine.
TEST_F(AfmProgramsTest, AServerThatHangsWhileAStationPressesLeavesTheTipWithdrawn) {
  struct Pressed {
    Simulator simulator;
    ChildProcess server, run;
    explicit Pressed(const std::string& afm)
        : server(serve(simulator.ports(), afm)),
          run({kMaster, "run", "--server", "127.0.0.1:" + std::to_string(port_of(server)), "--task", "indent",
               "--duration-s", "60"}) {}
  };
  const std::string afm = changed("reply_timeout_ms", "2000.0");
  Pressed soon(afm), late(afm);
  for (Pressed* one : {&soon, &late}) ASSERT_TRUE(one->run.wait_for_err("engaged", kLong)) << one->run.err();
  ::usleep(500'000);
  for (Pressed* one : {&soon, &late}) one->server.signal(SIGSTOP);
  const std::string before = soon.simulator.stop();
  EXPECT_NE(before.find("tip out"), std::string::npos) << before;

  ::usleep(13'000'000);
  const std::string after = late.simulator.stop();
  EXPECT_NE(after.find("tip withdrawn"), std::string::npos) << after;
  // Without a controller these guards would go on for ever.
  for (Pressed* one : {&soon, &late}) {
    const pid_t guard = guard_of(one->server);
    ASSERT_GT(guard, 0);
    ::kill(guard, SIGKILL);
  }
}

// The guard has no limit of time: it stays until the controller has answered, and the next server waits for
// it. That server has the first one's port, as after a restart by systemd: the guard must not hold it.
TEST_F(AfmProgramsTest, AControllerThatIsSilentWhileTheServerDiesEndsWithdrawn) {
  const std::string control = path("faults.txt");
  Simulator simulator({"--control", control});
  const std::string file = afm();
  ChildProcess server(serve(simulator.ports(), file));
  const int port = port_of(server);
  ASSERT_GT(port, 0);
  const pid_t guard = guard_of(server);
  ASSERT_GT(guard, 0);
  write("faults.txt", "silent 3600s\n");
  ASSERT_TRUE(simulator.says("silent 3600s"));
  server.signal(SIGKILL);
  ASSERT_TRUE(server.wait(kLong));
  ChildProcess next(serve(simulator.ports(), file, port));
  EXPECT_TRUE(next.wait_for_err("waiting for the guard of the last run", kLong)) << next.err();
  ::usleep(300'000);
  EXPECT_TRUE(alive(guard)) << "the controller is still silent";
  write("faults.txt", "silent 0s\n");
  ASSERT_GT(port_of(next), 0) << next.err();
  EXPECT_FALSE(alive(guard));
  EXPECT_NE(next.err().find("did not end with the tip withdrawn"), std::string::npos) << next.err();
  const pid_t last = guard_of(next);
  next.signal(SIGTERM);
  EXPECT_TRUE(next.wait(kLong));
  EXPECT_TRUE(last > 0 && ends(last));
  const std::string end = simulator.stop();
  EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
}

// What the rig has felt is all that a server without a station may do: it is not to approach by itself,
// however often it is started.
TEST_F(AfmProgramsTest, AServerThatWasKilledApproachesAgainOnlyOnAnOperatorsWord) {
  Simulator simulator;
  const std::string file = afm(), folder = file.substr(0, file.rfind('/'));
  const auto killed = [&](ChildProcess& server) {
    ASSERT_GT(port_of(server), 0) << server.err();
    const pid_t guard = guard_of(server);
    server.signal(SIGKILL);
    EXPECT_TRUE(server.wait(kLong));
    EXPECT_TRUE(guard > 0 && ends(guard));
  };
  const std::vector<std::string> approve{kNve, "afm", "approve", "--afm-state", folder};
  const Finished early = run_program(approve);
  EXPECT_EQ(early.exit_code, 2);
  EXPECT_NE(early.err.find("nothing to approve"), std::string::npos) << early.err;

  ChildProcess first(serve(simulator.ports(), file));
  killed(first);
  EXPECT_NE(first.err().find("approaching"), std::string::npos);
  for (int i = 0; i < 2; ++i) {
    ChildProcess next(serve(simulator.ports(), file));
    killed(next);
    EXPECT_NE(next.err().find("did not end with the tip withdrawn"), std::string::npos) << next.err();
    EXPECT_EQ(next.err().find("approaching"), std::string::npos) << next.err();
  }
  // Used once, by a server that waits.
  ChildProcess waits(serve(simulator.ports(), file));
  ASSERT_GT(port_of(waits), 0);
  const Finished approved = run_program(approve);
  EXPECT_EQ(approved.exit_code, 0) << approved.err;
  EXPECT_TRUE(waits.wait_for_err("surface found", kLong)) << waits.err();
  killed(waits);
  ChildProcess again(serve(simulator.ports(), file));
  ASSERT_GT(port_of(again), 0);
  EXPECT_EQ(again.err().find("approaching"), std::string::npos) << again.err();
  // Or by one that comes later; it ends as it should, and the next one needs no word.
  EXPECT_EQ(run_program(approve).exit_code, 0);
  EXPECT_TRUE(again.wait_for_err("surface found", kLong)) << again.err();
  const pid_t guard = guard_of(again);
  again.signal(SIGTERM);
  EXPECT_TRUE(again.wait(kLong));
  EXPECT_TRUE(guard > 0 && ends(guard));
  ChildProcess last(serve(simulator.ports(), file));
  EXPECT_TRUE(last.wait_for_err("surface found", kLong)) << last.err();
  const pid_t last_guard = guard_of(last);
  last.signal(SIGTERM);
  EXPECT_TRUE(last.wait(kLong));
  EXPECT_TRUE(last_guard > 0 && ends(last_guard));
  EXPECT_NE(simulator.stop().find("tip withdrawn"), std::string::npos);
}

// A command that a killed server has sent may be read after its guard has gone.
TEST_F(AfmProgramsTest, ACommandThatComesAfterTheGuardHasGoneMovesNothing) {
  for (const char* const sign : {"1", "-1"}) {
    Simulator simulator({"--z-sign", sign});
    ChildProcess server(serve(simulator.ports(), changed("z_sign", sign)));
    ASSERT_GT(port_of(server), 0) << server.err();
    const pid_t guard = guard_of(server);
    server.signal(SIGKILL);
    ASSERT_TRUE(server.wait(kLong));
    ASSERT_TRUE(guard > 0 && ends(guard));
    // ZCtrl.ZPosSet of 0, the middle of the range, as the protocol's document has it; then its error's reply.
    std::string frame = "ZCtrl.ZPosSet";
    frame.resize(32, '\0');
    for (const int byte : {0, 0, 0, 4, 0, 1, 0, 0, 0, 0, 0, 0}) frame += static_cast<char>(byte);
    net::TcpStream late = net::TcpStream::connect(
        net::parse_address("127.0.0.1:" + simulator.ports({0}), "test"), 2'000'000'000);
    std::size_t n = 0;
    ASSERT_EQ(late.write({reinterpret_cast<const std::uint8_t*>(frame.data()), frame.size()}, n),
              net::TcpStream::Status::kOk);
    std::array<std::uint8_t, 256> reply{};
    for (int i = 0; i < 1000 && late.read(reply, n) == net::TcpStream::Status::kWouldBlock; ++i)
      ::usleep(10'000);
    const std::string end = simulator.stop();
    EXPECT_NE(end.find("tip withdrawn"), std::string::npos) << end;
    // A clean state for the other sign.
    for (const auto& entry : std::filesystem::directory_iterator(path("")))
      if (entry.path().extension() == ".out") std::filesystem::remove(entry.path());
  }
}

// The answers of the controller are in the server's sockets when it goes on. It stands still for twice the
// time-out of a reply, half of what the guard waits for.
TEST_F(AfmProgramsTest, AServerThatStoodStillItselfDoesNotFindTheControllerSilent) {
  Simulator simulator;
  ChildProcess server(serve(simulator.ports(), changed("reply_timeout_ms", "2000.0")));
  ASSERT_GT(port_of(server), 0);
  server.signal(SIGSTOP);
  ::usleep(4'000'000);
  server.signal(SIGCONT);
  server.signal(SIGTERM);
  ASSERT_TRUE(server.wait(kLong));
  EXPECT_EQ(server.exit_code(), 0);
  EXPECT_EQ(server.err().find("does not answer"), std::string::npos) << server.err();
  EXPECT_NE(server.err().find("withdrawn: exit"), std::string::npos) << server.err();
}

}  // namespace
}  // namespace telenano::programs

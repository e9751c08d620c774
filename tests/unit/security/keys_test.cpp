// Key files: what is taken, what is refused and in which words, and that no message holds a secret.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <functional>
#include <sstream>
#include <string>
#include <vector>

#include "telenano/common/base/error.h"
#include "telenano/common/base/utc_time.h"
#include "telenano/common/security/key_admin.h"
#include "telenano/common/security/key_list.h"
#include "telenano/common/security/private_file.h"

namespace telenano::security {
namespace {

const std::string kHex = "00112233445566778899aabbccddeeff0123456789abcdef0123456789abcdef";

class KeysTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("telenano_keys_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& text, mode_t mode = 0600) const {
    std::ofstream(path(name), std::ios::binary) << text;
    ::chmod(path(name).c_str(), mode);
    return path(name);
  }
  static std::string text_of(const std::string& file) {
    std::ostringstream text;
    text << std::ifstream(file).rdbuf();
    return text.str();
  }
  static mode_t mode_of(const std::string& file) {
    struct stat info {};
    ::stat(file.c_str(), &info);
    return info.st_mode & 07777;
  }
  template <class Work>
  static std::string complaint(Work&& work) {
    try {
      work();
    } catch (const UserError& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      return error.what();
    }
    return "";
  }

  std::filesystem::path folder_;
};

TEST_F(KeysTest, ANewKeyIsInTheListAndInTheStationsFile) {
  new_key(path("keys.toml"), "omega-1", net::Rights::kObserve, path("omega-1.key"));
  new_key(path("keys.toml"), "omega-2", net::Rights::kAdminister, path("omega-2.key"));
  EXPECT_EQ(mode_of(path("keys.toml")), 0600u);
  EXPECT_EQ(mode_of(path("omega-1.key")), 0600u);
  const KeyList list = load_key_list(path("keys.toml"));
  ASSERT_EQ(list.keys.size(), 2u);
  const StationKey one = load_station_key(path("omega-1.key"));
  const StationKey two = load_station_key(path("omega-2.key"));
  EXPECT_EQ(one.identity, "omega-1");
  EXPECT_TRUE(equal(one.psk, list.find_key("omega-1")->psk));
  EXPECT_TRUE(equal(two.psk, list.find_key("omega-2")->psk));
  EXPECT_FALSE(equal(one.psk, two.psk));
  EXPECT_EQ(list.find_key("omega-1")->rights, net::Rights::kObserve);
  EXPECT_EQ(list.find_key("omega-2")->rights, net::Rights::kAdminister);
  EXPECT_EQ(list.find_key("omega"), nullptr);
  EXPECT_EQ(list_keys(path("keys.toml")),
            "kind,identity,rights,expires\npsk,omega-1,observe,\npsk,omega-2,administer,\n");

  revoke_key(path("keys.toml"), "omega-1");
  EXPECT_EQ(load_key_list(path("keys.toml")).find_key("omega-1"), nullptr);
  EXPECT_NE(load_key_list(path("keys.toml")).find_key("omega-2"), nullptr);
  EXPECT_EQ(mode_of(path("keys.toml")), 0600u);
}

// Against the calendar as Python's datetime has it.
TEST(UtcTime, IsTheCalendars) {
  const std::pair<const char*, std::int64_t> known[] = {
      {"1970-01-01T00:00:00Z", 0},           {"1972-02-29T23:59:59Z", 68255999},
      {"2000-02-29T12:34:56Z", 951827696},   {"2026-11-23T03:30:00Z", 1795404600},
      {"2038-01-19T03:14:08Z", 2147483648},  {"2100-03-01T00:00:00Z", 4107542400},
      {"9999-12-31T23:59:59Z", 253402300799}};
  for (const auto& [text, unix_s] : known) {
    EXPECT_EQ(utc_text(unix_s), text);
    EXPECT_EQ(parse_utc(text), unix_s) << text;
  }
  for (const char* wrong :
       {"", "2027", "2027-01-31", "2027-01-31T12:00:00", "2027-01-31 12:00:00Z", "2027-01-31T12:00:00+01:00",
        "2027-02-29T00:00:00Z", "2100-02-29T00:00:00Z", "2027-13-01T00:00:00Z", "2027-00-01T00:00:00Z",
        "2027-01-31T24:00:00Z", "2027-01-31T12:60:00Z", "2027-01-31T12:00:60Z", "2O27-01-31T12:00:00Z",
        "1969-12-31T23:59:59Z", "2027-01-31T12:00:00Z "})
    EXPECT_FALSE(parse_utc(wrong)) << wrong;
  // There and back, over 8000 years in odd steps; each text is later than the one before.
  std::string last;
  for (std::int64_t unix_s = 0; unix_s < 253402300800; unix_s += 7'654'321) {
    const std::string text = utc_text(unix_s);
    ASSERT_EQ(parse_utc(text), unix_s) << text;
    ASSERT_LT(last, text);
    last = text;
  }
}

TEST_F(KeysTest, WhatHasExpiredIsInTheListAndNotInForce) {
  const std::string text =
      "[[key]]\nidentity = \"a\"\npsk = \"" + kHex +
      "\"\nrights = \"operate\"\nexpires = \"2027-01-31T12:00:00Z\"\n\n[[certificate]]\n"
      "name = \"c\"\nrights = \"observe\"\nexpires = \"2027-01-31T12:00:01Z\"\n\n[[key]]\n"
      "identity = \"b\"\npsk = \"" +
      kHex + "\"\nrights = \"operate\"\n\n[[public]]\nidentity = \"d\"\nkey = \"sha256:" + kHex +
      "\"\nrights = \"operate\"\nexpires = \"2027-01-31T12:00:02Z\"\n";
  const KeyList list = parse_key_list(text, "keys.toml");
  const std::int64_t end_s = *parse_utc("2027-01-31T12:00:00Z");
  EXPECT_NE(list.find_key("a"), nullptr);
  EXPECT_NE(list.in_force(end_s - 1).find_key("a"), nullptr);
  EXPECT_EQ(list.in_force(end_s).find_key("a"), nullptr);
  EXPECT_NE(list.in_force(end_s).find_certificate("c", ""), nullptr);
  EXPECT_EQ(list.in_force(end_s + 1).find_certificate("c", ""), nullptr);
  EXPECT_NE(list.in_force(end_s + 1'000'000'000).find_key("b"), nullptr) << "has no end";
  EXPECT_EQ(list.next_expiry_s(0), end_s);
  EXPECT_EQ(list.next_expiry_s(end_s), end_s + 1);
  EXPECT_EQ(list.next_expiry_s(end_s + 1), end_s + 2);
  EXPECT_EQ(list.next_expiry_s(end_s + 2), std::nullopt);
  EXPECT_NE(list.in_force(end_s + 1).find_public_key(kHex), nullptr);
  EXPECT_EQ(list.in_force(end_s + 2).find_public_key(kHex), nullptr);
  const KeyList again = parse_key_list(key_list_text(list), "again");
  EXPECT_EQ(again.find_key("a")->expires_s, end_s);
  EXPECT_EQ(again.find_key("b")->expires_s, std::nullopt);
  EXPECT_EQ(again.find_certificate("c", "")->expires_s, end_s + 1);
  std::string wrong = text;
  wrong.replace(wrong.find("2027"), 20, "tomorrow");
  EXPECT_NE(complaint([&] { parse_key_list(wrong, "keys.toml"); }).find("2027-01-31T12:00:00Z"),
            std::string::npos);
}

TEST_F(KeysTest, AKeyThatFollowsHasItsRightsAndTheOldOneEnds) {
  constexpr std::int64_t kEnd = 2'000'000'000, kLater = 2'100'000'000;
  new_key(path("keys.toml"), "omega-1", net::Rights::kObserve, path("1.key"));
  EXPECT_EQ(rotate_key(path("keys.toml"), "omega-1", path("2.key"), kEnd, kLater), "omega-1.2");
  KeyList list = load_key_list(path("keys.toml"));
  EXPECT_EQ(list.find_key("omega-1")->expires_s, kEnd);
  EXPECT_TRUE(equal(list.find_key("omega-1")->psk, load_station_key(path("1.key")).psk)) << "still opens";
  EXPECT_EQ(list.find_key("omega-1.2")->rights, net::Rights::kObserve);
  EXPECT_EQ(list.find_key("omega-1.2")->expires_s, kLater);
  const StationKey next = load_station_key(path("2.key"));
  EXPECT_EQ(next.identity, "omega-1.2");
  EXPECT_TRUE(equal(next.psk, list.find_key("omega-1.2")->psk));
  EXPECT_FALSE(equal(next.psk, list.find_key("omega-1")->psk));
  EXPECT_EQ(mode_of(path("2.key")), 0600u);

  // Once more the same: another name, and the end that was sooner stays.
  EXPECT_EQ(rotate_key(path("keys.toml"), "omega-1", path("3.key"), kLater), "omega-1.3");
  EXPECT_EQ(rotate_key(path("keys.toml"), "omega-1.3", path("4.key"), kEnd), "omega-1.4");
  list = load_key_list(path("keys.toml"));
  EXPECT_EQ(list.find_key("omega-1")->expires_s, kEnd);
  EXPECT_EQ(list.find_key("omega-1.4")->expires_s, std::nullopt);

  const std::string before = text_of(path("keys.toml"));
  EXPECT_NE(complaint([&] {
              rotate_key(path("keys.toml"), "omega-2", path("5.key"), kEnd);
            }).find("did you mean 'omega-1'?"),
            std::string::npos);
  EXPECT_NE(complaint([&] { rotate_key(path("keys.toml"), "omega-1.4", path("4.key"), kEnd); }).find("4.key"),
            std::string::npos)
      << "the station's file is there";
  EXPECT_EQ(text_of(path("keys.toml")), before) << "nothing half done";
}

TEST_F(KeysTest, HexIsReadDigitByDigit) {
  const StationKey key = load_station_key(write("a.key", "identity = \"a\"\npsk = \"" + kHex + "\"\n"));
  EXPECT_EQ(key.psk.bytes[0], 0x00);
  EXPECT_EQ(key.psk.bytes[1], 0x11);
  EXPECT_EQ(key.psk.bytes[15], 0xff);
  EXPECT_EQ(key.psk.bytes[16], 0x01);
  EXPECT_EQ(key.psk.bytes[31], 0xef);
  EXPECT_EQ(station_key_text(key).find(kHex) != std::string::npos, true);
}

TEST_F(KeysTest, EveryBitOfAKeyCounts) {
  const Psk a;
  EXPECT_TRUE(equal(a, Psk()));
  for (std::size_t bit = 0; bit < 8 * Psk::kBytes; ++bit) {
    Psk b;
    b.bytes[bit / 8] ^= static_cast<std::uint8_t>(1u << (bit % 8));
    EXPECT_FALSE(equal(a, b)) << bit;
  }
}

TEST_F(KeysTest, CertificatesAreKnownByNameOrFingerprint) {
  const std::string print(64, 'a');
  const KeyList list = load_key_list(write("keys.toml",
                                           "[[certificate]]\nname = \"omega-3\"\nrights = \"observe\"\n"
                                           "[[certificate]]\nfingerprint = \"" +
                                               print + "\"\nrights = \"operate\"\n"));
  ASSERT_NE(list.find_certificate("omega-3", ""), nullptr);
  EXPECT_EQ(list.find_certificate("omega-3", "")->rights, net::Rights::kObserve);
  EXPECT_EQ(list.find_certificate("omega-3", print)->rights, net::Rights::kOperate);
  // No name and no fingerprint must not fit an entry that has none.
  EXPECT_EQ(list.find_certificate("", ""), nullptr);
  const KeyList again = load_key_list(write("again.toml", key_list_text(list)));
  EXPECT_EQ(again.certificates.size(), 2u);
  revoke_key(path("again.toml"), print);
  revoke_key(path("again.toml"), "omega-3");
  EXPECT_TRUE(load_key_list(path("again.toml")).certificates.empty());
}

TEST_F(KeysTest, FilesThatOthersCanReadAreRefusedWithTheCommandThatMendsIt) {
  const std::string text = "identity = \"a\"\npsk = \"" + kHex + "\"\n";
  for (const mode_t mode : {0640u, 0604u, 0620u, 0602u, 0610u, 0601u, 0644u, 0777u}) {
    const std::string file = write("open.key", text, mode);
    EXPECT_NE(complaint([&] { load_station_key(file); }).find("chmod 600 " + file), std::string::npos)
        << mode;
    EXPECT_NE(complaint([&] { load_key_list(file); }).find("chmod 600 " + file), std::string::npos) << mode;
    EXPECT_NE(complaint([&] { require_private_file(file, "--cert-key"); }).find("--cert-key"),
              std::string::npos);
  }
  for (const mode_t mode : {0600u, 0400u, 0700u})
    EXPECT_EQ(complaint([&] { load_station_key(write("mine.key", text, mode)); }), "") << mode;
  ::mkfifo(path("pipe").c_str(), 0600);
  EXPECT_NE(complaint([&] { load_station_key(path("pipe")); }).find("not a plain file"), std::string::npos);
  EXPECT_NE(complaint([&] { load_station_key(folder_.string()); }).find("not a plain file"),
            std::string::npos);
  EXPECT_NE(complaint([&] { load_station_key(path("none")); }).find("No such file"), std::string::npos);
}

TEST_F(KeysTest, WhatIsWrongIsNamedAndNeverTheSecret) {
  const std::string psk = "psk = \"" + kHex + "\"\n";
  const std::string id = "identity = \"a\"\n";
  const struct {
    std::string text, named;
  } station[] = {
      {id, "psk"},
      {psk, "identity"},
      {id + "psk = \"" + kHex + "00\"\n", "64 lower-case"},
      {id + "psk = \"" + kHex.substr(1) + "\"\n", "64 lower-case"},
      {id + "psk = \"G" + kHex.substr(1) + "\"\n", "64 lower-case"},
      {id + "psk = " + kHex + "\n", "TOML"},
      {id + "psk = \"" + kHex + "\n", "TOML"},
      {id + psk + psk, "psk"},
      {id + psk + "right = 1\n", "right"},
      {"identity = \"a b\"\n" + psk, "1 to 64 letters"},
      {"identity = \"\"\n" + psk, "1 to 64 letters"},
      {"identity = \"" + std::string(65, 'a') + "\"\n" + psk, "1 to 64 letters"},
  };
  const auto expect = [&](const std::string& said, const std::string& named) {
    EXPECT_NE(said.find(named), std::string::npos) << said;
    EXPECT_EQ(said.find(kHex.substr(4, 8)), std::string::npos) << said;
  };
  for (const auto& wrong : station)
    expect(complaint([&] { load_station_key(write("wrong.key", wrong.text)); }), wrong.named);
  const struct {
    std::string text, named;
  } lists[] = {
      {"[[key]]\n" + id + psk, "rights"},
      {"[[key]]\n" + id + psk + "rights = \"all\"\n", "observe"},
      {"[[key]]\n" + id + psk + "rights = \"observe\"\n[[key]]\n" + id + psk + "rights = \"observe\"\n",
       "comes twice"},
      {"[[keys]]\n" + id + psk, "keys"},
      {"[[certificate]]\nrights = \"observe\"\n", "either a name or a fingerprint"},
      {"[[certificate]]\nname=\"a\"\nfingerprint = \"" + std::string(64, 'a') + "\"\nrights = \"observe\"\n",
       "either a name or a fingerprint"},
      {"[[certificate]]\nfingerprint = \"AA:BB\"\nrights = \"observe\"\n", "without colons"},
  };
  for (const auto& wrong : lists)
    expect(complaint([&] { load_key_list(write("wrong.toml", wrong.text)); }), wrong.named);
}

TEST_F(KeysTest, NothingIsOverwrittenAndNothingHalfDone) {
  new_key(path("keys.toml"), "a", net::Rights::kOperate, path("a.key"));
  const std::string before = text_of(path("keys.toml"));
  EXPECT_NE(complaint([&] {
              new_key(path("keys.toml"), "a", net::Rights::kOperate, path("b.key"));
            }).find("'a' already"),
            std::string::npos);
  EXPECT_NE(complaint([&] {
              new_key(path("keys.toml"), "b", net::Rights::kOperate, path("a.key"));
            }).find("exists"),
            std::string::npos);
  EXPECT_NE(complaint([&] {
              new_key(path("keys.toml"), "../b", net::Rights::kOperate, path("b.key"));
            }).find("name"),
            std::string::npos);
  EXPECT_NE(complaint([&] { revoke_key(path("keys.toml"), "aa"); }).find("'aa'"), std::string::npos);
  EXPECT_NE(complaint([&] { revoke_key(path("none.toml"), "a"); }).find("none.toml"), std::string::npos);
  // Another program at work on the same list.
  write("keys.toml.new", "");
  EXPECT_NE(complaint([&] {
              new_key(path("keys.toml"), "b", net::Rights::kOperate, path("b.key"));
            }).find("keys.toml.new"),
            std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(path("b.key")));
  EXPECT_EQ(text_of(path("keys.toml")), before);
}

/// Runs each of `works` in a process of its own, all let go at once; how many failed.
int failures_at_once(const std::vector<std::function<void()>>& works) {
  std::array<int, 2> gate{};
  EXPECT_EQ(::pipe(gate.data()), 0);
  std::vector<pid_t> children;
  for (const auto& work : works) {
    const pid_t child = ::fork();
    if (child != 0) {
      children.push_back(child);
      continue;
    }
    ::close(gate[1]);
    char byte = 0;
    (void)!::read(gate[0], &byte, 1);  // until the parent closes its end
    try {
      work();
      ::_exit(0);
    } catch (const std::exception& error) {
      std::fprintf(stderr, "%s\n", error.what());
      ::_exit(1);
    }
  }
  ::close(gate[0]);
  ::close(gate[1]);
  int failed = 0;
  for (const pid_t child : children) {
    int status = 0;
    EXPECT_EQ(::waitpid(child, &status, 0), child);
    failed += WIFEXITED(status) && WEXITSTATUS(status) == 0 ? 0 : 1;
  }
  return failed;
}

TEST_F(KeysTest, WhatManyProgramsChangeAtOnceIsAllDone) {
  // Each of eight lets in one key and takes out another: none may fail, no key come back or be missing.
  constexpr int kEach = 4;
  for (int round = 0; round < 10; ++round) {
    const std::string list = path("keys" + std::to_string(round) + ".toml");
    const auto name = [](const char* kind, int i) { return kind + std::to_string(i); };
    const auto file = [&](const std::string& of) { return path(of + "." + std::to_string(round)); };
    for (int i = 0; i < kEach; ++i)
      new_key(list, name("old", i), net::Rights::kOperate, file(name("old", i)));
    std::vector<std::function<void()>> works;
    for (int i = 0; i < kEach; ++i) {
      works.push_back([&, i] { new_key(list, name("new", i), net::Rights::kObserve, file(name("new", i))); });
      works.push_back([&, i] { revoke_key(list, name("old", i)); });
    }
    EXPECT_EQ(failures_at_once(works), 0) << round;
    const KeyList after = load_key_list(list);
    for (int i = 0; i < kEach; ++i) {
      EXPECT_EQ(after.find_key(name("old", i)), nullptr) << "a revoked key is back: " << list_keys(list);
      EXPECT_NE(after.find_key(name("new", i)), nullptr) << list_keys(list);
    }
  }
}

TEST_F(KeysTest, WhoKeepsTheListForTooLongIsNamed) {
  const std::string list = path("keys.toml");
  new_key(list, "a", net::Rights::kOperate, path("a.key"));
  const int held = ::open((list + ".lock").c_str(), O_RDWR);
  ASSERT_GE(held, 0);
  ASSERT_EQ(::flock(held, LOCK_EX | LOCK_NB), 0) << "nobody holds it between two changes";
  const std::string said = complaint([&] { PrivateFileLock(list, "--keys", 50); });
  EXPECT_NE(said.find("another program, which holds " + list + ".lock"), std::string::npos) << said;
  ::close(held);
  EXPECT_EQ(complaint([&] { PrivateFileLock(list, "--keys", 50); }), "");
  EXPECT_EQ(mode_of(list + ".lock"), 0600u);
}

}  // namespace
}  // namespace telenano::security

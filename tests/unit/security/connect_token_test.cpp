// Connect tokens: what a name says, who can make one, and what a server takes, by its own clock.
#include "telenano/common/security/connect_token.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "telenano/common/base/error.h"
#include "telenano/common/base/random.h"
#include "telenano/common/security/key_admin.h"
#include "tests/unit/security/dtls_rig.h"

namespace telenano::security {
namespace {

constexpr std::int64_t kNow_s = 1'764'000'000;
constexpr std::int64_t kEnd_s = kNow_s + 600;

Issuer lab(net::Rights most = net::Rights::kOperate, std::uint8_t fill = 5) {
  return {"lab", psk_of(fill), most};
}

TokenName named(const std::string& station, net::Rights rights = net::Rights::kOperate) {
  return {"lab", station, rights, kEnd_s};
}

std::string complaint(const std::function<void()>& work) {
  try {
    work();
  } catch (const UserError& error) {
    EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    return error.what();
  }
  return "";
}

TEST(ConnectToken, ANameSaysWhoWhatAndUntilWhen) {
  const std::string identity = token_identity(named("omega-1"));
  EXPECT_EQ(identity, "t.1764000600.operate.lab.omega-1");
  const auto name = parse_token_name("t.1764000600.observe.lab_2.omega-1.left");
  ASSERT_TRUE(name);
  EXPECT_EQ(name->issuer, "lab_2");
  EXPECT_EQ(name->station, "omega-1.left");
  EXPECT_EQ(name->rights, net::Rights::kObserve);
  EXPECT_EQ(name->expires_s, kEnd_s);
  for (const char* bad :
       {"", "t", "t.", "omega-1", "t.1764000600.operate.lab", "t.1764000600.operate.lab.",
        "t.01764000600.operate.lab.a", "t.+1764000600.operate.lab.a", "t.0.operate.lab.a",
        "t.-1.operate.lab.a", "t.99999999999.operate.lab.a", "t.1764000600.Operate.lab.a",
        "t.1764000600.operate..a", "t.1764000600.operate.a-name-of-17-char.a", "t.1764000600.operate.lab.a b",
        "T.1764000600.operate.lab.a", "t.1764000600x.operate.lab.a", "t.99999999999999999999.operate.lab.a"})
    EXPECT_FALSE(parse_token_name(bad)) << bad;
  const std::string longest(64 - std::string("t.1764000600.operate.lab.").size(), 'x');
  EXPECT_EQ(parse_token_name(token_identity(named(longest)))->station, longest);
  EXPECT_NE(complaint([&] { token_identity(named(longest + "x")); }).find("1 to 39 letters"),
            std::string::npos);
  EXPECT_NE(complaint([&] { token_identity(named("a b")); }), "");
  EXPECT_NE(complaint([&] { token_identity(named("")); }), "");
}

// Oracle: Python's hmac and hashlib, over the bytes that the documents name.
TEST(ConnectToken, TheKeyIsAnHmacOfTheName) {
  const Psk psk = token_psk(lab(), "t.1764000600.operate.lab.omega-1");
  std::string text;
  for (const std::uint8_t byte : psk.bytes) {
    text += "0123456789abcdef"[byte >> 4];
    text += "0123456789abcdef"[byte & 15];
  }
  EXPECT_EQ(text, "842a49ef0a0c54ff6886988e561562990dded4a18878110e6d90a3fd2844ee0f");
}

TEST(ConnectToken, OnlyAnIssuerOfTheListGivesAndNoMoreThanHeMay) {
  KeyList list = two_keys();
  list.issuers.push_back(lab());
  const auto grant = list.find_grant(token_identity(named("omega-9")));
  ASSERT_TRUE(grant);
  EXPECT_TRUE(equal(grant->psk, make_token(lab(), named("omega-9"), "a:1").key.psk));
  EXPECT_EQ(grant->rights, net::Rights::kOperate);
  EXPECT_EQ(grant->expires_s, kEnd_s);
  EXPECT_EQ(grant->name, "lab:omega-9");
  EXPECT_FALSE(list.find_grant(token_identity(named("omega-9", net::Rights::kAdminister))));
  EXPECT_TRUE(list.find_grant(token_identity(named("omega-9", net::Rights::kObserve))));
  EXPECT_FALSE(list.find_grant("t.1764000600.operate.other.omega-9"));
  EXPECT_EQ(list.find_grant("omega-1")->name, "omega-1");
  EXPECT_FALSE(list.find_grant("nobody"));
  EXPECT_NE(
      complaint([] { make_token(lab(net::Rights::kObserve), named("a"), "a:1"); }).find("observe at most"),
      std::string::npos);
  // The next token of the same station is the same one; another station's, or another issuer's, is not.
  TokenName later = named("omega-9", net::Rights::kObserve);
  later.expires_s += 1000;
  EXPECT_EQ(list.find_grant(token_identity(later))->number, grant->number);
  EXPECT_NE(list.find_grant(token_identity(named("omega-8")))->number, grant->number);
  EXPECT_NE(list.find_grant("omega-1")->number, grant->number);
}

struct TokenRig {
  std::int64_t now_s = kNow_s;
  DtlsServerConfig config;
  std::unique_ptr<DtlsRig> rig;

  explicit TokenRig(const Issuer& issuer = lab()) {
    config.unix_time_s = [this] { return now_s; };
    config.grant_names = std::make_shared<GrantNames>();
    KeyList list;
    list.issuers.push_back(issuer);
    rig = std::make_unique<DtlsRig>(list, config);
  }
  bool lets_in(const StationKey& key) {
    DtlsClientConfig station;
    station.key = key;
    rig->connect(station);
    rig->turns(4);
    return rig->station->established();
  }
};

TEST(ConnectToken, LetsInWithItsRight) {
  TokenRig t;
  ASSERT_TRUE(t.lets_in(make_token(lab(), named("omega-9", net::Rights::kObserve), "a:1").key));
  ASSERT_TRUE(t.rig->hears("hello"));
  EXPECT_EQ(t.rig->received.standing.rights, net::Rights::kObserve);
  EXPECT_EQ(t.config.grant_names->name_of(t.rig->received.standing.identity), "lab:omega-9");
}

TEST(ConnectToken, WithoutTheSecretNobodyMakesOneOrChangesOne) {
  const StationKey good = make_token(lab(), named("omega-9", net::Rights::kObserve), "a:1").key;
  const auto refused = [](const StationKey& key) { return !TokenRig().lets_in(key); };
  EXPECT_FALSE(refused(good));
  EXPECT_TRUE(refused(make_token(lab(net::Rights::kOperate, 6), named("omega-9"), "a:1").key));
  for (const char* changed : {"t.1764000600.operate.lab.omega-9", "t.1764009999.observe.lab.omega-9",
                              "t.1764000600.observe.lab.omega-8"})
    EXPECT_TRUE(refused({changed, good.psk})) << changed;
}

// By the server's clock: it begins nothing from the moment that it names; what it has begun goes on.
TEST(ConnectToken, ExpiresToTheSecondAndEndsNothingThatRuns) {
  const StationKey key = make_token(lab(), named("omega-9"), "a:1").key;
  for (const bool over : {false, true}) {
    TokenRig t;
    t.now_s = over ? kEnd_s : kEnd_s - 1;
    EXPECT_EQ(t.lets_in(key), !over);
    EXPECT_EQ(t.rig->station->failure().find("does not know") != std::string::npos, over);
  }
  TokenRig t;
  ASSERT_TRUE(t.lets_in(key));
  t.now_s = kEnd_s + 100;
  t.rig->pass_ms(1000);
  EXPECT_TRUE(t.rig->hears("still here"));
  // After an outage too, by what was agreed on.
  t.rig->station->send(bytes_of("lost"), t.rig->server_end.address());
  t.rig->network.drop_waiting(t.rig->server_end.address());
  t.rig->pass_ms(501);
  t.rig->turns(6);
  EXPECT_EQ(t.rig->station->counters().resumed, 1u);
  EXPECT_TRUE(t.rig->hears("back"));
}

TEST(ConnectToken, RevokingTheIssuerOrChangingHisSecretEndsWhatItsTokensHaveBegun) {
  for (const int what : {0, 1, 2, 3}) {
    TokenRig t;
    ASSERT_TRUE(t.lets_in(make_token(lab(), named("omega-9"), "a:1").key));
    KeyList list = two_keys();
    if (what == 0) list.issuers = {};
    if (what == 1) list.issuers = {lab(net::Rights::kOperate, 6)};
    if (what == 2) list.issuers = {lab(net::Rights::kObserve)};
    if (what == 3) list.issuers = {lab(), {"other", psk_of(7), net::Rights::kOperate}};
    t.rig->server->offer_keys(list);
    t.rig->turn();
    EXPECT_EQ(t.rig->server->established(), what == 3 ? 1u : 0u) << what;
  }
}

class TokenFiles : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string folder = (std::filesystem::temp_directory_path() / "telenano_token_XXXXXX").string();
    ASSERT_NE(::mkdtemp(folder.data()), nullptr);
    folder_ = folder;
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(path(name)) << text;
    ::chmod(path(name).c_str(), 0600);
    return path(name);
  }
  std::filesystem::path folder_;
};

TEST_F(TokenFiles, AnIssuerGoesFromOneServersListToAnothers) {
  new_issuer(path("a.toml"), "lab", net::Rights::kOperate, path("lab.issuer"));
  EXPECT_EQ(adopt_issuer(path("b.toml"), path("lab.issuer")), "lab");
  const KeyList a = load_key_list(path("a.toml")), b = load_key_list(path("b.toml"));
  const ConnectToken token = make_token(load_issuer(path("lab.issuer")), named("omega-9"), "a:1,b:2");
  for (const KeyList& list : {a, b}) {
    ASSERT_EQ(list.issuers.size(), 1u);
    EXPECT_TRUE(equal(list.find_grant(token.key.identity)->psk, token.key.psk));
  }
  EXPECT_NE(list_keys(path("a.toml")).find("issuer,lab,operate,\n"), std::string::npos);
  EXPECT_NE(complaint([&] { adopt_issuer(path("b.toml"), path("lab.issuer")); }).find("already"),
            std::string::npos);
  EXPECT_NE(complaint([&] { new_issuer(path("a.toml"), "lab", net::Rights::kObserve, path("x")); }), "");
  EXPECT_FALSE(std::filesystem::exists(path("x"))) << "a secret that opens nothing";
  EXPECT_NE(complaint([&] { new_issuer(path("a.toml"), "a.b", net::Rights::kObserve, path("x")); }), "");
  revoke_key(path("a.toml"), "lab");
  EXPECT_TRUE(load_key_list(path("a.toml")).issuers.empty());
  EXPECT_NE(complaint([&] { revoke_key(path("b.toml"), "lap"); }).find("did you mean 'lab'"),
            std::string::npos);
}

TEST_F(TokenFiles, ATokenIsReadAsItWasWrittenAndSaysWhenItHasExpired) {
  const ConnectToken token = make_token(lab(), named("omega-9"), "a.lab:5100,[::1]:5200");
  const std::string file = write("t.token", token_text(token));
  const ConnectToken again = load_token(file);
  EXPECT_EQ(again.servers, token.servers);
  EXPECT_EQ(again.key.identity, token.key.identity);
  EXPECT_TRUE(equal(again.key.psk, token.key.psk));
  EXPECT_EQ(again.expires_s, kEnd_s);
  EXPECT_EQ(complaint([&] { require_in_force(again, file, kEnd_s - 1); }), "");
  const std::string said = complaint([&] { require_in_force(again, file, kEnd_s); });
  EXPECT_NE(said.find("has expired at 2025-11-24T16:10:00Z"), std::string::npos) << said;
  const std::string text = token_text(token);
  for (std::size_t size = 0; size < text.size(); ++size)
    EXPECT_NO_FATAL_FAILURE(complaint([&] { load_token(write("cut.token", text.substr(0, size))); }));
  Random random(3);
  for (int i = 0; i < 2000; ++i) {
    std::string bad = text;
    for (int k = 0; k < 3; ++k) bad[random.bits() % bad.size()] = static_cast<char>(random.bits());
    complaint([&] { load_token(write("bad.token", bad)); });
  }
}

}  // namespace
}  // namespace telenano::security

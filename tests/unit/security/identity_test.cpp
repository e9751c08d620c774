// Associations by key pairs of each end's own: who gets in, who is at the other end, and what a list that changes does.
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "telenano/common/base/error.h"
#include "telenano/common/security/identity_file.h"
#include "tests/unit/security/dtls_rig.h"

namespace telenano::security {
namespace {

using Event = SecurityEvent;

class IdentityTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / ("telenano_identity_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
    server_key_ = public_key_digits(create_identity(path("server.id"), "test"));
    station_key_ = public_key_digits(create_identity(path("omega-1.id"), "test"));
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  KeyList knows(const std::vector<std::string>& keys, net::Rights rights = net::Rights::kOperate) const {
    KeyList list;
    for (const std::string& key : keys) list.public_keys.push_back({"omega-1", key, rights, {}});
    return list;
  }
  DtlsServerConfig server() const {
    DtlsServerConfig config;
    config.identity = path("server.id");
    return config;
  }
  DtlsClientConfig station(const std::string& file = "omega-1.id") const {
    DtlsClientConfig config;
    config.identity = path(file);
    config.server_keys = {server_key_};
    return config;
  }
  static std::string text_of(const std::string& file) {
    std::ostringstream text;
    text << std::ifstream(file).rdbuf();
    return text.str();
  }

  std::filesystem::path folder_;
  std::string server_key_, station_key_;
};

TEST_F(IdentityTest, EachEndKnowsTheOtherByItsKey) {
  DtlsRig rig(knows({station_key_}, net::Rights::kAdminister), server());
  rig.connect(station());
  rig.turns(20);
  ASSERT_TRUE(rig.station->established()) << rig.station->failure();
  EXPECT_TRUE(rig.hears("hello"));
  EXPECT_EQ(rig.received.standing.rights, net::Rights::kAdminister);
  EXPECT_EQ(rig.received.standing.identity, identity_number('p', "omega-1"));
  EXPECT_STREQ(rig.server->identity(rig.station_end.address()), "omega-1");
}

TEST_F(IdentityTest, AStrangersPairIsRefused) {
  create_identity(path("false.id"), "test");
  DtlsRig rig(knows({station_key_}), server());
  rig.connect(station("false.id"));
  rig.turns(20);
  EXPECT_FALSE(rig.station->established());
  EXPECT_TRUE(rig.station->refused());
  EXPECT_NE(rig.station->failure().find("does not know the public key of"), std::string::npos)
      << rig.station->failure();
  EXPECT_EQ(rig.server->established(), 0u);
  EXPECT_GE(rig.events(Event::kRefusedCertificate), 1u);
}

TEST_F(IdentityTest, AnotherServerIsRefusedBeforeAnythingIsSaid) {
  DtlsServerConfig other;
  other.identity = path("other.id");
  const std::string shown = public_key_digits(create_identity(other.identity, "test"));
  DtlsRig rig(knows({station_key_}), other);
  rig.connect(station());
  rig.turns(20);
  EXPECT_FALSE(rig.station->established());
  EXPECT_NE(rig.station->failure().find("shows sha256:" + shown), std::string::npos)
      << rig.station->failure();
  // One of several that the station knows is enough.
  DtlsClientConfig both = station();
  both.server_keys.push_back(shown);
  rig.connect(both);
  rig.turns(20);
  EXPECT_TRUE(rig.station->established());
}

/// Whoever has seen a certificate go by has no key to it.
TEST_F(IdentityTest, AnothersCertificateWithAPairsKeyIsNoIdentity) {
  create_identity(path("thief.id"), "test");
  const std::string own = text_of(path("thief.id")), seen = text_of(path("omega-1.id"));
  const std::string begin = "-----BEGIN CERTIFICATE-----";
  std::ofstream(path("mixed.id")) << own.substr(0, own.find(begin)) + seen.substr(seen.find(begin));
  ::chmod(path("mixed.id").c_str(), 0600);
  EXPECT_THROW(read_identity_name(path("mixed.id"), "test"), UserError);
  DtlsRig rig(knows({station_key_}), server());
  EXPECT_THROW(rig.connect(station("mixed.id")), UserError);
}

TEST_F(IdentityTest, TwoPairsAreOneStationAndRevokingOneLeavesTheOther) {
  const std::string next_key = public_key_digits(create_identity(path("next.id"), "test"));
  DtlsRig rig(knows({station_key_, next_key}), server());
  rig.connect(station("next.id"));
  rig.turns(20);
  ASSERT_TRUE(rig.hears("new"));
  const std::uint64_t number = rig.received.standing.identity;
  rig.server->offer_keys(knows({next_key}));
  EXPECT_TRUE(rig.hears("still")) << "the first pair's end is none of the second's";
  rig.connect(station());
  rig.turns(20);
  EXPECT_FALSE(rig.station->established());
  EXPECT_EQ(number, identity_number('p', "omega-1"));
}

TEST_F(IdentityTest, ARevokedPairIsOutAndResumesNothing) {
  DtlsRig rig(knows({station_key_}), server());
  rig.connect(station());
  rig.turns(20);
  ASSERT_TRUE(rig.hears("hello"));
  KeyList other = two_keys();
  other.public_keys.push_back({"omega-1", std::string(64, 'a'), net::Rights::kOperate, {}});
  rig.server->offer_keys(other);
  EXPECT_FALSE(rig.hears("still here?"));
  EXPECT_EQ(rig.events(Event::kRevoked), 1u);
  // The same object, which has what the first handshake agreed on.
  for (int i = 0; i < 20; ++i) {
    rig.pass_ms(300);
    rig.turns(5);
  }
  EXPECT_FALSE(rig.station->established());
}

TEST_F(IdentityTest, KeysAndPairsAtOneServer) {
  KeyList both = two_keys();
  both.public_keys = knows({station_key_}).public_keys;
  DtlsRig rig(both, server());
  rig.connect("omega-1", 1);
  rig.turns(20);
  ASSERT_TRUE(rig.hears("by a secret"));
  EXPECT_EQ(rig.received.standing.identity, identity_number('k', "omega-1"));
  rig.connect(station());
  rig.turns(20);
  ASSERT_TRUE(rig.hears("by a pair"));
  EXPECT_EQ(rig.received.standing.identity, identity_number('p', "omega-1"));
}

}  // namespace
}  // namespace telenano::security

// Associations with X.509 certificates, made here: who gets in, and what a person is told otherwise.
#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>

#include "telenano/common/base/error.h"
#include "tests/unit/security/dtls_rig.h"

namespace telenano::security {
namespace {

using Event = SecurityEvent;

/// A certificate and its key in memory and as files.
struct Made {
  X509* certificate = nullptr;
  EVP_PKEY* key = nullptr;
  std::string certificate_file, key_file;
};

struct Wanted {
  std::string name;
  std::string alternative;  ///< subjectAltName, e.g. "IP:10.0.0.1"
  long from_s = -3600;
  long to_s = 3600;
  bool authority = false;
};

class CertificatesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    folder_ =
        std::filesystem::temp_directory_path() / ("telenano_certificates_" + std::to_string(::getpid()));
    std::filesystem::create_directories(folder_);
    lab_ = make("lab-ca", {"lab-ca", "", -3600, 3600, true}, nullptr);
    server_ = make("server", {"nve", "IP:10.0.0.1,DNS:nve.lab"}, &lab_);
    station_ = make("station", {"omega-3", ""}, &lab_);
  }
  void TearDown() override {
    for (Made& made : all_) {
      X509_free(made.certificate);
      EVP_PKEY_free(made.key);
    }
    std::filesystem::remove_all(folder_);
  }

  Made make(const std::string& file, const Wanted& wanted, const Made* signer) {
    Made made;
    made.key = EVP_EC_gen("P-256");
    made.certificate = X509_new();
    X509* const c = made.certificate;
    X509_set_version(c, 2);
    ASN1_INTEGER_set(X509_get_serialNumber(c), static_cast<long>(all_.size()) + 1);
    X509_gmtime_adj(X509_getm_notBefore(c), wanted.from_s);
    X509_gmtime_adj(X509_getm_notAfter(c), wanted.to_s);
    X509_set_pubkey(c, made.key);
    X509_NAME_add_entry_by_txt(X509_get_subject_name(c), "CN", MBSTRING_ASC,
                               reinterpret_cast<const unsigned char*>(wanted.name.c_str()), -1, -1, 0);
    X509* const issuer = signer != nullptr ? signer->certificate : c;
    X509_set_issuer_name(c, X509_get_subject_name(issuer));
    X509V3_CTX context;
    X509V3_set_ctx(&context, issuer, c, nullptr, nullptr, 0);
    const auto extend = [&](int nid, const std::string& value) {
      X509_EXTENSION* const extension = X509V3_EXT_conf_nid(nullptr, &context, nid, value.c_str());
      X509_add_ext(c, extension, -1);
      X509_EXTENSION_free(extension);
    };
    extend(NID_basic_constraints, wanted.authority ? "critical,CA:TRUE" : "CA:FALSE");
    if (!wanted.alternative.empty()) extend(NID_subject_alt_name, wanted.alternative);
    X509_sign(c, signer != nullptr ? signer->key : made.key, EVP_sha256());
    made.certificate_file = (folder_ / (file + ".pem")).string();
    made.key_file = (folder_ / (file + "-key.pem")).string();
    FILE* out = std::fopen(made.certificate_file.c_str(), "w");
    PEM_write_X509(out, c);
    std::fclose(out);
    out = std::fopen(made.key_file.c_str(), "w");
    PEM_write_PrivateKey(out, made.key, nullptr, nullptr, 0, nullptr, nullptr);
    std::fclose(out);
    ::chmod(made.key_file.c_str(), 0600);
    all_.push_back(made);
    return made;
  }

  static KeyList list() {
    KeyList keys = two_keys();
    keys.certificates.push_back({"omega-3", "", net::Rights::kOperate});
    return keys;
  }
  DtlsServerConfig server_config(const Made& own, const Made& authority) {
    DtlsServerConfig config;
    config.certificates = CertificateFiles{own.certificate_file, own.key_file, authority.certificate_file};
    return config;
  }
  DtlsClientConfig station_config(const Made& own, const Made& authority,
                                  const std::string& server = "10.0.0.1") {
    DtlsClientConfig config;
    config.certificates = CertificateFiles{own.certificate_file, own.key_file, authority.certificate_file};
    config.server_name = server;
    return config;
  }
  /// What a station is told that does not get in; "" if it does.
  std::string refusal(const DtlsServerConfig& server, const DtlsClientConfig& station,
                      const KeyList& keys = list()) {
    DtlsRig rig(keys, server);
    rig.connect(station);
    rig.turns(8);
    EXPECT_EQ(rig.station->established(), rig.server->established() == 1);
    EXPECT_EQ(rig.station->refused(), !rig.station->established());
    refused_certificates_ = rig.events(Event::kRefusedCertificate);
    return rig.station->established() ? "" : rig.station->failure();
  }
  template <class Work>
  static std::string complaint(Work&& work) {
    try {
      work();
    } catch (const UserError& error) {
      return error.what();
    }
    return "";
  }

  std::filesystem::path folder_;
  std::vector<Made> all_;
  Made lab_, server_, station_;
  std::uint64_t refused_certificates_ = 0;
};

TEST_F(CertificatesTest, BothSidesShowTheirsAndTheNameHasItsRights) {
  DtlsRig rig(list(), server_config(server_, lab_));
  rig.connect(station_config(station_, lab_));
  rig.turns(8);
  ASSERT_TRUE(rig.station->established()) << rig.station->failure();
  EXPECT_STREQ(rig.server->identity(rig.station_end.address()), "omega-3");
  ASSERT_TRUE(rig.hears("hello"));
  EXPECT_EQ(rig.received.standing.rights, net::Rights::kOperate);
  // Nothing of a handshake is too long for a path of 1280 bytes.
  for (const auto& packet : rig.network.sent()) EXPECT_LE(packet.bytes.size(), 1200u);
}

TEST_F(CertificatesTest, AServerWithCertificatesTakesKeysToo) {
  DtlsRig rig(list(), server_config(server_, lab_));
  rig.connect();
  rig.turns(4);
  EXPECT_TRUE(rig.station->established());
}

TEST_F(CertificatesTest, AServerMayBeCalledByNameOrAddressThatItsCertificateHas) {
  EXPECT_EQ(refusal(server_config(server_, lab_), station_config(station_, lab_, "nve.lab")), "");
  EXPECT_NE(refusal(server_config(server_, lab_), station_config(station_, lab_, "other.lab"))
                .find("not for 'other.lab'"),
            std::string::npos);
  EXPECT_NE(refusal(server_config(server_, lab_), station_config(station_, lab_, "10.0.0.2"))
                .find("not for '10.0.0.2'"),
            std::string::npos);
}

TEST_F(CertificatesTest, AFingerprintIsEnoughAndWinsOverTheName) {
  std::array<unsigned char, 32> digest{};
  unsigned size = 0;
  X509_digest(station_.certificate, EVP_sha256(), digest.data(), &size);
  std::string print;
  for (const unsigned char byte : digest) {
    std::array<char, 3> two{};
    std::snprintf(two.data(), two.size(), "%02x", byte);
    print += two.data();
  }
  KeyList keys = list();
  keys.certificates.push_back({"", print, net::Rights::kObserve});
  DtlsRig rig(keys, server_config(server_, lab_));
  rig.connect(station_config(station_, lab_));
  rig.turns(8);
  ASSERT_TRUE(rig.hears("hello"));
  EXPECT_EQ(rig.received.standing.rights, net::Rights::kObserve);
  EXPECT_EQ(rig.server->identity(rig.station_end.address()), print);
}

TEST_F(CertificatesTest, AStationThatIsNotInTheListIsRefused) {
  const Made other = make("other", {"omega-4", ""}, &lab_);
  EXPECT_NE(
      refusal(server_config(server_, lab_), station_config(other, lab_)).find("not in the server's list"),
      std::string::npos);
  EXPECT_EQ(refused_certificates_, 1u);
  // A longer name that begins like one in the list, and one that is too long for the list.
  for (const std::string& name : {std::string("omega-33"), std::string("omega-")}) {
    const Made like = make("like", {name, ""}, &lab_);
    EXPECT_NE(refusal(server_config(server_, lab_), station_config(like, lab_)), "") << name;
  }
}

TEST_F(CertificatesTest, AStationOfAnotherAuthorityOrNoneIsRefused) {
  const Made evil = make("evil-ca", {"lab-ca", "", -3600, 3600, true}, nullptr);  // same name, another key
  const Made forged = make("forged", {"omega-3", ""}, &evil);
  const Made alone = make("alone", {"omega-3", ""}, nullptr);
  EXPECT_NE(refusal(server_config(server_, lab_), station_config(forged, lab_)), "");
  EXPECT_NE(refusal(server_config(server_, lab_), station_config(alone, lab_)).find("authority"),
            std::string::npos);
  // A station's certificate must not make others.
  const Made child = make("child", {"omega-3", ""}, &station_);
  EXPECT_NE(refusal(server_config(server_, lab_), station_config(child, lab_)), "");
}

TEST_F(CertificatesTest, AServerOfAnotherAuthorityIsRefused) {
  const Made evil = make("evil-ca", {"lab-ca", "", -3600, 3600, true}, nullptr);
  const Made forged = make("forged", {"nve", "IP:10.0.0.1"}, &evil);
  const Made alone = make("alone", {"nve", "IP:10.0.0.1"}, nullptr);
  EXPECT_NE(
      refusal(server_config(forged, lab_), station_config(station_, lab_)).find("signed by none of --ca"),
      std::string::npos);
  EXPECT_NE(
      refusal(server_config(alone, lab_), station_config(station_, lab_)).find("signed by none of --ca"),
      std::string::npos);
}

TEST_F(CertificatesTest, ExpiredOnesAreToldBeforeAndDuring) {
  const Made old = make("old", {"omega-3", "IP:10.0.0.1", -7200, -60}, &lab_);
  const Made early = make("early", {"omega-3", "IP:10.0.0.1", 3600, 7200}, &lab_);
  for (const Made& own : {old, early}) {
    const std::string said = complaint([&] { DtlsRig rig(list(), server_config(own, lab_)); });
    EXPECT_NE(said.find(own.certificate_file), std::string::npos) << said;
    EXPECT_NE(said.find("clock"), std::string::npos) << said;
  }
  // Ends while the program runs: valid for one second when it starts.
  const Made short_server = make("short-server", {"nve", "IP:10.0.0.1", -3600, 1}, &lab_);
  const Made short_station = make("short-station", {"omega-3", "", -3600, 1}, &lab_);
  DtlsRig with_old_server(list(), server_config(short_server, lab_));
  DtlsRig with_old_station(list(), server_config(server_, lab_));
  with_old_station.connect(station_config(short_station, lab_));
  ::sleep(3);
  with_old_server.connect(station_config(station_, lab_));
  with_old_server.turns(8);
  EXPECT_NE(with_old_server.station->failure().find("the server's certificate has expired"),
            std::string::npos)
      << with_old_server.station->failure();
  // What was sent before the pause may have to be sent again, which OpenSSL times by the wall clock.
  for (int i = 0; i < 100 && !with_old_station.station->refused(); ++i, ::usleep(50'000))
    with_old_station.turns(8);
  EXPECT_NE(with_old_station.station->failure().find("it has expired"), std::string::npos)
      << with_old_station.station->failure();
}

TEST_F(CertificatesTest, AKeyWhereACertificateIsWantedAndTheOtherWayRound) {
  const std::string said = refusal({}, station_config(station_, lab_));  // a server with keys only
  EXPECT_NE(said.find("agree on no way"), std::string::npos) << said;
}

TEST_F(CertificatesTest, FilesThatDoNotServeAreNamed) {
  const auto told = [&](const Made& own, const std::string& key, const std::string& authority) {
    DtlsServerConfig config;
    config.certificates = CertificateFiles{own.certificate_file, key, authority};
    return complaint([&] { DtlsRig rig(list(), config); });
  };
  EXPECT_EQ(told(server_, server_.key_file, lab_.certificate_file), "");
  EXPECT_NE(told(server_, station_.key_file, lab_.certificate_file).find("--cert-key"), std::string::npos);
  EXPECT_NE(told(server_, server_.certificate_file, lab_.certificate_file).find("chmod 600"),
            std::string::npos);
  EXPECT_NE(told(server_, "none.pem", lab_.certificate_file).find("none.pem"), std::string::npos);
  EXPECT_NE(told(server_, server_.key_file, "none.pem").find("--ca none.pem"), std::string::npos);
  EXPECT_NE(told(server_, server_.key_file, server_.key_file).find("--ca"), std::string::npos);
  Made missing = server_;
  missing.certificate_file = "none.pem";
  EXPECT_NE(told(missing, server_.key_file, lab_.certificate_file).find("--cert none.pem"),
            std::string::npos);
  ::chmod(server_.key_file.c_str(), 0640);
  EXPECT_NE(told(server_, server_.key_file, lab_.certificate_file).find("chmod 600"), std::string::npos);
}

TEST_F(CertificatesTest, ACertificateTakenOffTheListEndsItsAssociation) {
  DtlsRig rig(list(), server_config(server_, lab_));
  rig.connect(station_config(station_, lab_));
  rig.turns(8);
  ASSERT_TRUE(rig.station->established());
  rig.server->offer_keys(list());
  rig.turn();
  EXPECT_EQ(rig.server->established(), 1u);
  rig.server->offer_keys(two_keys());
  rig.turn();
  EXPECT_EQ(rig.server->established(), 0u);
  rig.pass_ms(501);
  rig.turns(8);
  EXPECT_FALSE(rig.station->established());
}

TEST_F(CertificatesTest, AResumedAssociationStillHasItsIdentity) {
  DtlsRig rig(list(), server_config(server_, lab_));
  rig.connect(station_config(station_, lab_));
  rig.turns(8);
  rig.station->send(bytes_of("lost"), rig.server_end.address());
  rig.network.drop_waiting(rig.server_end.address());
  rig.pass_ms(501);
  rig.turns(6);
  EXPECT_EQ(rig.station->counters().resumed, 1u);
  EXPECT_STREQ(rig.server->identity(rig.station_end.address()), "omega-3");
}

}  // namespace
}  // namespace telenano::security

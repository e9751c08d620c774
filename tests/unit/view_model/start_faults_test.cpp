#include "telenano/master/view_model/start_faults.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

namespace telenano::view_model {
namespace {

std::string of_server(const std::string& server) {
  StartChoice choice;
  choice.server = server;
  const StartFaults faults = start_faults(choice);
  EXPECT_EQ(faults.first(), faults.server);
  return faults.server;
}

TEST(StartFaults, WhatCanBeAServerHasNone) {
  for (const char* const server :
       {"127.0.0.1:5100", "lab:1", "lab.example.org:65535", "[::1]:5100", "[fe80::1%eth0]:5100", "a-b_c.d:7",
        "m\u00fcnchen:5100", "[127.0.0.1]:5100"})
    EXPECT_EQ(of_server(server), "") << server;
  EXPECT_EQ(of_server(std::string(253, 'a') + ":5100"), "");
}

// Each by its own cause: a line that a person can act on.
TEST(StartFaults, NonsenseInTheServersFieldIsOneLineThatSaysWhy) {
  const std::vector<std::pair<std::string, std::string>> all = {
      {"", "Name a server"},
      {"lab", "needs its port"},
      {":5100", "host is missing"},
      {"lab:", "Port ''"},
      {"lab:0", "Port '0'"},
      {"lab:99999", "Port '99999'"},
      {"lab:65536", "Port '65536'"},
      {"lab:4294972396", "Port '4294972396'"},  // 2^32 + 5100
      {"lab:-1", "Port '-1'"},
      {"lab:+1", "Port '+1'"},
      {"lab:51oo", "Port '51oo'"},
      {"lab: 5100", "Port ' 5100'"},
      {"::1:5100", "needs brackets"},
      {"fe80::1", "needs brackets"},
      {"[::1", "closing bracket"},
      {"[::1]", "port behind the bracket"},
      {"[::1]5100", "port behind the bracket"},
      {"[::1]:0", "Port '0'"},
      {"[]:5100", "host is missing"},
      {"lab 1:5100", "'lab 1' is no host"},
      {" lab:5100", "' lab' is no host"},
      {"/etc/passwd:5100", "is no host"},
      {"-x:5100", "'-x' is no host"},
      {"http://lab:5100", "Leave out what stands before the host"},
      {"lab:51:00", "One colon"},
      {"2001:db8:0:0:0:0:0:1:5100", "needs brackets"},
      {"lab:5100,", "Port '5100,'"},
      {",lab:5100", "',lab' is no host"},
      {"lab1:5100,lab2:5100", "One colon"},
      {"l\aab:5100", "Character 2 is a control character (0x07)"},
      {"lab:5100\n", "control character (0x0a)"},
      {"lab\x7f:5100", "control character (0x7f)"},
      {"l\xff:5100", "Byte 2 is no text"},
      {"l\xc3:5100", "Byte 2 is no text"},              // begun and not ended
      {"l\xc0\xaf:5100", "Byte 2 is no text"},          // longer than needed
      {"l\xed\xa0\x80:5100", "Byte 2 is no text"},      // half a pair of UTF-16
      {"l\xf4\x90\x80\x80:5100", "Byte 2 is no text"},  // beyond the last character
      {"l\xe2\x82", "Byte 2 is no text"},
      {std::string(254, 'a') + ":5100", "at most 253 characters, this one has 254"},
      {std::string(10000, 'x'), "At most 4095 characters, these are 10000"},
      {std::string(4000, ':'), "needs brackets"},
  };
  for (const auto& [server, why] : all) {
    const std::string fault = of_server(server);
    EXPECT_NE(fault.find(why), std::string::npos) << "'" << server << "': " << fault;
    EXPECT_EQ(fault.find('\n'), std::string::npos) << fault;
    EXPECT_LT(fault.size(), 160u) << "one line: " << fault;
  }
}

TEST(StartFaults, NonsenseInTheOtherFields) {
  const std::string digits(64, 'a');
  StartChoice choice;
  choice.identity = "omega.id";
  for (const std::string& key : {std::string("sha256:ab"), digits, "sha256:" + digits + "a",
                                 "SHA256:" + digits, "sha256:" + std::string(64, 'A'),
                                 "sha256:" + digits + ",", std::string("\xff\x01"), std::string(4000, 'x')}) {
    choice.server_key = key;
    EXPECT_NE(start_faults(choice).server_key.find("64 lower-case hexadecimal digits"), std::string::npos)
        << key;
  }
  choice.server_key = std::string(10000, 'x');
  EXPECT_NE(start_faults(choice).server_key.find("At most 4095"), std::string::npos);
  choice.server_key = "sha256:" + digits;
  EXPECT_EQ(start_faults(choice).first(), "");
  choice.server_key += ",sha256:" + digits;
  EXPECT_EQ(start_faults(choice).first(), "") << "several keys";
  choice.identity = std::string(4096, 'x');
  EXPECT_NE(start_faults(choice).identity.find("this one has 4096"), std::string::npos);
  choice = {};
  choice.key = std::string(10000, 'x');
  EXPECT_NE(start_faults(choice).key.find("this one has 10000"), std::string::npos);
  choice.key = "any \xff\x01 bytes may be a file's name";
  EXPECT_EQ(start_faults(choice).first(), "");
  choice.server_scene = "fl\x01";
  EXPECT_NE(start_faults(choice).server_scene.find("0x01"), std::string::npos);
  choice.server_scene = std::string(256, 'x');
  EXPECT_NE(start_faults(choice).server_scene.find("at most 255"), std::string::npos);
  choice = {};
  choice.recording = std::string(10000, 'x');
  EXPECT_EQ(start_faults(choice).first(), "") << "switched off";
  choice.record = true;
  EXPECT_NE(start_faults(choice).recording.find("this one has 10000"), std::string::npos);
  EXPECT_EQ(start_faults(choice).first_field(), "Recording");
  choice.recording.clear();
  EXPECT_NE(start_faults(choice).recording.find("Name the recording's file"), std::string::npos);
}

TEST(StartFaults, KeysThatDoNotGoTogetherAreToldWhereOneIsToBeChanged) {
  StartChoice choice;
  choice.identity = "omega 1.id";
  EXPECT_NE(start_faults(choice).server_key.find("server's key too"), std::string::npos);
  choice.server_key = "sha256:" + std::string(64, '0');
  EXPECT_EQ(start_faults(choice).first(), "");
  choice.key = "lab.key";
  EXPECT_NE(start_faults(choice).key.find("clear one"), std::string::npos);
  EXPECT_EQ(start_faults(choice).first_field(), "Key file");
  choice.key.clear();
  choice.identity.clear();
  EXPECT_NE(start_faults(choice).identity.find("own key pair too"), std::string::npos);
}

// The field that is higher on the screen comes first, and a look at files adds only where nothing was told.
TEST(StartFaults, TheFirstOneIsThatOfTheHighestField) {
  StartFaults faults;
  EXPECT_EQ(faults.first() + faults.first_field(), "");
  faults.recording = "r";
  EXPECT_EQ(faults.first(), "r");
  StartFaults more;
  more.recording = "other";
  more.server = "s";
  faults.add(more);
  EXPECT_EQ(faults.recording, "r");
  EXPECT_EQ(faults.first(), "s");
  EXPECT_EQ(faults.first_field(), "Server");
}

TEST(StartFaults, AProgramsLineAboutAFlagGoesToItsField) {
  StartFaults faults;
  StartChoice choice;
  EXPECT_FALSE(take_flag_fault(": what has no name", choice, faults));
  EXPECT_TRUE(
      take_flag_fault("telenano-master: --server 'nowhere:1': cannot find host 'nowhere'", choice, faults));
  EXPECT_EQ(faults.server, "--server 'nowhere:1': cannot find host 'nowhere'");
  EXPECT_TRUE(take_flag_fault("telenano-master: --server-key 'x': expected", choice, faults));
  EXPECT_EQ(faults.server_key, "--server-key 'x': expected") << "not that of --server";
  EXPECT_TRUE(
      take_flag_fault("--key a.key: holds a secret but its mode 0644 lets others at it", choice, faults));
  EXPECT_NE(faults.key.find("0644"), std::string::npos);
  EXPECT_TRUE(
      take_flag_fault("telenano-master: --server-scene 'x': the server has 'flakes'", choice, faults));
  EXPECT_NE(faults.server_scene, "");
  EXPECT_TRUE(take_flag_fault("telenano-master: key file lab.key: holds a secret but its mode is 0644",
                              choice, faults));
  EXPECT_NE(faults.key.find("mode is"), std::string::npos);
  choice.identity = "omega.id";
  EXPECT_TRUE(take_flag_fault("telenano-master: omega.id: line 1: expected a table", choice, faults));
  EXPECT_NE(faults.identity.find("expected a table"), std::string::npos);
  EXPECT_FALSE(take_flag_fault("telenano-master: no answer from 127.0.0.1:9", choice, faults));
  EXPECT_FALSE(take_flag_fault("telenano-master: --keyboard x", choice, faults));
  EXPECT_TRUE(take_flag_fault("telenano-master: --identity " + std::string(9000, 'x'), choice, faults));
  EXPECT_EQ(faults.identity.size(), 300 + std::string("…").size());
}

TEST(StartFaults, ShownTextIsTextAndNotTooLong) {
  EXPECT_EQ(shown_text("m\u00fcrbe", 9), "m\u00fcrbe");
  EXPECT_EQ(shown_text("m\u00fcrbe", 5), "m\u00fcrbe");
  EXPECT_EQ(shown_text("m\u00fcrbe", 2), "m\u00fc…");
  EXPECT_EQ(shown_text("a\xff\x01z\n", 9), "a??z?");
  EXPECT_EQ(shown_text("\u20ac", 1), "\u20ac");
  EXPECT_EQ(shown_text("\xe2\x82", 9), "??");
  EXPECT_EQ(shown_text("", 0), "");
  EXPECT_EQ(shown_text(std::string(10000, 'x'), 3), "xxx…");
}

}  // namespace
}  // namespace telenano::view_model

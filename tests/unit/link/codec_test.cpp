#include "telenano/common/link/codec.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <limits>

#include "golden_messages.h"
#include "proto/wire_fields.h"
#include "telenano/common/link/wire_scan.h"
#include "tests/source_dir.h"

namespace telenano::link {
namespace {

using Bytes = std::vector<std::uint8_t>;

std::vector<Bytes> golden_files() {
  std::vector<Bytes> all;
  for (const char* name : kGoldenNames) {
    std::ifstream file(std::string(TELENANO_SOURCE_DIR) + "/proto/golden/" + name + ".bin", std::ios::binary);
    all.emplace_back(std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>());
  }
  return all;
}

/// A datagram by hand: header, then fields as given.
Bytes datagram(MessageType type, const Bytes& payload) {
  Bytes bytes(kHeaderBytes);
  write_header(std::span<std::uint8_t, kHeaderBytes>(bytes.data(), kHeaderBytes), type, payload.size());
  bytes.insert(bytes.end(), payload.begin(), payload.end());
  return bytes;
}

DropCause decode(const Bytes& bytes) {
  Codec codec;
  Incoming in;
  const DropCause cause = codec.decode(bytes, in);
  EXPECT_EQ(cause == DropCause::kNone, in.type != MessageType::kNone);
  return cause;
}

const Bytes kBye = {0x09, 1, 0, 0, 0, 0, 0, 0, 0, 0x15, 1, 0, 0, 0};  // session 1, reason 1

TEST(Golden, FilesDecodeToTheirMessages) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  const auto files = golden_files();
  for (std::size_t i = 0; i < files.size(); ++i) {
    ASSERT_EQ(codec.decode(files[i], in), DropCause::kNone) << kGoldenNames[i];
    EXPECT_TRUE(matches(in, golden, i)) << kGoldenNames[i];
  }
}

TEST(Golden, MessagesEncodeToWhatDecodesTheSame) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  const auto all = golden.encoded();
  for (std::size_t i = 0; i < all.size(); ++i) {
    ASSERT_EQ(codec.decode(all[i], in), DropCause::kNone);
    EXPECT_TRUE(matches(in, golden, i)) << kGoldenNames[i];
  }
}

TEST(Golden, OurOwnBytesAreTheFiles) {
  // More than the protocol asks of an implementation: fields that are zero are not on the wire, so that a
  // session without features is the same bytes as before there were any.
  EXPECT_EQ(GoldenMessages{}.encoded(), golden_files());
}

TEST(Golden, AMessageWithoutFeaturesClearsThoseOfTheOneBefore) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  const auto files = golden_files();
  for (const std::size_t which : {9u, 7u, 4u, 8u, 5u}) {
    ASSERT_EQ(codec.decode(files[which], in), DropCause::kNone);
    EXPECT_TRUE(matches(in, golden, which)) << kGoldenNames[which];
  }
  // The same through the encoder, whose messages are reused too.
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  EXPECT_EQ(codec.encode(golden.command_with_features, out), files[7].size());
  EXPECT_EQ(codec.encode(golden.command, out), files[4].size());
  EXPECT_EQ(codec.encode(golden.reply_with_features, out), files[8].size());
  EXPECT_EQ(codec.encode(golden.reply, out), files[5].size());
}

TEST(Golden, EveryTruncationAndExtensionIsDropped) {
  Codec codec;
  Incoming in;
  for (const auto& file : golden_files()) {
    for (std::size_t n = 0; n < file.size(); ++n) {
      EXPECT_EQ(codec.decode(std::span(file).first(n), in), DropCause::kTruncated);
    }
    Bytes longer = file;
    longer.push_back(0);
    EXPECT_EQ(codec.decode(longer, in), file.size() == 512 ? DropCause::kOversize : DropCause::kBadLength);
  }
}

TEST(Golden, EverySingleByteCorruptionIsDroppedOrAnotherValue) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  std::size_t accepted = 0;
  const auto files = golden_files();
  for (std::size_t which = 0; which < files.size(); ++which) {
    const Bytes& file = files[which];
    const auto type = static_cast<MessageType>(file[5]);
    for (std::size_t at = 0; at < file.size(); ++at) {
      for (int flip = 1; flip < 256; ++flip) {
        Bytes bytes = file;
        bytes[at] = static_cast<std::uint8_t>(bytes[at] ^ flip);
        const DropCause cause = codec.decode(bytes, in);
        if (cause != DropCause::kNone) continue;
        ++accepted;
        // Header bytes: the version of Hello and Refuse does not count, and with another type the same fields
        // may make another message (a Challenge is a Command of two fields, of a session that does not
        // exist). Elsewhere it is the value that changed, except in a Hello's padding, which is ignored.
        if (at == 5) {
          EXPECT_NE(in.type, type);
        } else if (at < 8) {
          EXPECT_TRUE(at == 4 && (type == MessageType::kHello || type == MessageType::kRefuse)) << at;
        } else if (type != MessageType::kHello) {
          EXPECT_FALSE(matches(in, golden, which)) << kGoldenNames[which] << " byte " << at;
        }
      }
    }
  }
  EXPECT_GT(accepted, 10000u);
}

TEST(Codec, NamesTheCauseOfEachDrop) {
  EXPECT_EQ(decode({}), DropCause::kTruncated);
  EXPECT_EQ(decode(datagram(MessageType::kBye, kBye)), DropCause::kNone);
  Bytes b = datagram(MessageType::kBye, kBye);
  b[0] = 'X';
  EXPECT_EQ(decode(b), DropCause::kBadMagic);
  b = datagram(MessageType::kBye, kBye);
  b[4] = 2;
  EXPECT_EQ(decode(b), DropCause::kWrongVersion);
  EXPECT_EQ(decode(datagram(static_cast<MessageType>(15), kBye)), DropCause::kUnknownType);
  EXPECT_EQ(decode(datagram(MessageType::kNone, kBye)), DropCause::kUnknownType);
  EXPECT_EQ(decode(Bytes(513)), DropCause::kOversize);
  EXPECT_EQ(decode(datagram(MessageType::kHello, {0x0d, 1, 0, 0, 0})), DropCause::kBadLength) << "not padded";

  const auto with = [](std::initializer_list<std::uint8_t> extra) {
    Bytes payload = kBye;
    payload.insert(payload.end(), extra);
    return datagram(MessageType::kBye, payload);
  };
  EXPECT_EQ(decode(with({0x1d, 1, 0, 0, 0})), DropCause::kMalformedField) << "unknown field 3";
  EXPECT_EQ(decode(with({0x22, 1, 0})), DropCause::kMalformedField) << "unknown length-delimited field";
  EXPECT_EQ(decode(with({0x15, 1, 0, 0, 0})), DropCause::kMalformedField) << "field 2 twice";
  EXPECT_EQ(decode(with({0x00})), DropCause::kMalformedField) << "field 0";
  EXPECT_EQ(decode(with({0x80})), DropCause::kMalformedField) << "tag cut";
  EXPECT_EQ(decode(with({0x80, 0x80, 0x80, 0x01})), DropCause::kMalformedField) << "long tag";
  EXPECT_EQ(decode(with({0x0b})), DropCause::kMalformedField) << "group";
  EXPECT_EQ(decode(datagram(MessageType::kBye, {0x08, 1})), DropCause::kMalformedField)
      << "varint for fixed64";
  EXPECT_EQ(decode(datagram(MessageType::kBye, {0x09, 1, 0, 0})), DropCause::kMalformedField) << "value cut";
  EXPECT_EQ(decode(datagram(MessageType::kBye, {0x89, 0x00, 1, 0, 0, 0, 0, 0, 0, 0})),
            DropCause::kMalformedField)
      << "tag not in its shortest form";

  EXPECT_EQ(decode(datagram(MessageType::kBye, {0x09, 1, 0, 0, 0, 0, 0, 0, 0})), DropCause::kOutOfRange)
      << "no reason";
  EXPECT_EQ(decode(datagram(MessageType::kBye, {})), DropCause::kOutOfRange) << "no session";
}

TEST(Codec, RepeatedCommandsAreWholeRecordsInOrderAtTheEnd) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_of = [&](const RecentCommands& recent, std::uint64_t sequence = 1001) {
    Command c = golden.command_with_features;
    c.sequence = sequence;
    const std::size_t n = codec.encode(c, recent, out);
    EXPECT_LE(n, kMaxDatagramBytes);
    return codec.decode(std::span(out).first(n), in);
  };
  for (std::size_t count = 0; count <= kMaxRecent; ++count) {
    RecentCommands recent = golden.recent;
    recent.count = count;
    EXPECT_EQ(cause_of(recent), DropCause::kNone) << count;
    EXPECT_TRUE(same(in.recent, recent)) << count;
  }
  EXPECT_EQ(cause_of(golden.recent, 5), DropCause::kNone);
  EXPECT_EQ(cause_of(golden.recent, 4), DropCause::kOutOfRange) << "a command before the first";
  RecentCommands bad = golden.recent;
  bad.record[2].age_ns = bad.record[1].age_ns - 1;
  EXPECT_EQ(cause_of(bad), DropCause::kOutOfRange) << "an older one that is younger";
  bad = golden.recent;
  bad.record[3].energy = -1;
  EXPECT_EQ(cause_of(bad), DropCause::kOutOfRange);
  for (int k = 0; k < 7; ++k) {
    bad = golden.recent;
    RecentCommand& r = bad.record[3];
    double* const fields[] = {&r.tip_pos_w_nm.x(), &r.tip_pos_w_nm.y(), &r.tip_pos_w_nm.z(), &r.energy,
                              &r.wave_sum.x(),     &r.wave_sum.y(),     &r.wave_sum.z()};
    *fields[k] = std::numeric_limits<double>::quiet_NaN();
    EXPECT_EQ(cause_of(bad), DropCause::kNonFinite) << k;
  }

  const std::size_t plain = codec.encode(golden.command, out);
  const Bytes command(out.begin() + kHeaderBytes, out.begin() + static_cast<std::ptrdiff_t>(plain));
  const auto with = [&](const Bytes& tail, bool in_front = false) {
    Bytes payload = in_front ? tail : command;
    const Bytes& rest = in_front ? command : tail;
    payload.insert(payload.end(), rest.begin(), rest.end());
    return decode(datagram(MessageType::kCommand, payload));
  };
  const auto records = [](std::size_t bytes) {
    Bytes tail = {0xc2, 0x02};
    if (bytes >= 0x80) tail.push_back(static_cast<std::uint8_t>((bytes & 0x7f) | 0x80));
    tail.push_back(static_cast<std::uint8_t>(bytes >= 0x80 ? bytes >> 7 : bytes));
    tail.insert(tail.end(), bytes, 0);
    return tail;
  };
  EXPECT_EQ(with(records(64)), DropCause::kNone);
  EXPECT_EQ(with(records(256)), DropCause::kNone);
  EXPECT_EQ(with(records(0)), DropCause::kMalformedField) << "none are not sent";
  EXPECT_EQ(with(records(63)), DropCause::kMalformedField) << "half a record";
  EXPECT_EQ(with(records(320)), DropCause::kMalformedField) << "five";
  EXPECT_EQ(with(records(64), true), DropCause::kMalformedField) << "not the last field";
  Bytes twice = records(64);
  const Bytes again = twice;
  twice.insert(twice.end(), again.begin(), again.end());
  EXPECT_EQ(with(twice), DropCause::kMalformedField);
  Bytes cut = records(64);
  cut.pop_back();
  EXPECT_EQ(with(cut), DropCause::kMalformedField);
  // Fields in another order before them take the slow way through the scan; the same must come out.
  Bytes turned(command.begin() + 9, command.end());
  turned.insert(turned.end(), command.begin(), command.begin() + 9);
  const std::size_t n = codec.encode(golden.command, golden.recent, out);
  turned.insert(turned.end(), out.begin() + static_cast<std::ptrdiff_t>(plain),
                out.begin() + static_cast<std::ptrdiff_t>(n));
  ASSERT_EQ(codec.decode(datagram(MessageType::kCommand, turned), in), DropCause::kNone);
  EXPECT_TRUE(same(in.command, golden.command) && same(in.recent, golden.recent));
}

TEST(Codec, RefusesALongSceneName) {
  const Bytes golden = golden_files()[2];
  const std::string name = "flakes";
  const auto found = std::search(golden.begin(), golden.end(), name.begin(), name.end());
  ASSERT_NE(found, golden.end());
  const std::ptrdiff_t at = found - golden.begin();
  Bytes file = golden;
  file.insert(file.begin() + at, 43, 'x');  // 49 bytes, and so says the length before them
  file[static_cast<std::size_t>(at) - 1] = 49;
  const std::size_t payload = file.size() - kHeaderBytes;
  file[6] = static_cast<std::uint8_t>(payload & 0xff);
  file[7] = static_cast<std::uint8_t>(payload >> 8);
  EXPECT_EQ(decode(file), DropCause::kMalformedField);
}

TEST(Codec, RefusesNonFiniteNumbersWhereverTheyAre) {
  const GoldenMessages golden;
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_of = [&](const auto& message) {
    const std::size_t n = codec.encode(message, out);
    return codec.decode(std::span(out).first(n), in);
  };
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity(),
                           -std::numeric_limits<double>::infinity()}) {
    for (int k = 0; k < 8; ++k) {
      Command c = golden.command;
      double* const fields[] = {&c.tip_vel_w_nm_s.x(), &c.tip_vel_w_nm_s.y(), &c.tip_vel_w_nm_s.z(),
                                &c.tip_pos_w_nm.x(),   &c.tip_pos_w_nm.y(),   &c.tip_pos_w_nm.z(),
                                &c.energy_in_j,        &c.energy_out_j};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(c), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 7; ++k) {
      Command c = golden.command_with_features;
      PortControl& p = c.control;
      double* const fields[] = {&p.energy_scale_aj_j,   &p.energy_sent_j, &p.wave_sum.x(),
                                &p.wave_sum.y(),        &p.wave_sum.z(),  &p.wave_energy_aj,
                                &p.wave_impedance_n_s_m};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(c), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 15; ++k) {
      Reply r = golden.reply_with_features;
      PortAnswer& p = r.port;
      LocalModel& m = r.model;
      double* const fields[] = {
          &p.energy_sent_aj, &p.wave_sum.x(),   &p.wave_sum.y(),   &p.wave_sum.z(),        &p.wave_energy_aj,
          &m.point_w_nm.x(), &m.point_w_nm.y(), &m.point_w_nm.z(), &m.normal_w.x(),        &m.normal_w.y(),
          &m.normal_w.z(),   &m.stiffness_n_m,  &m.adhesion_nn,    &m.shear_stiffness_n_m, &m.friction_nn};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(r), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 4; ++k) {
      Reply r = golden.reply_with_particle;
      Particle& p = r.particle;
      double* const fields[] = {&p.pos_w_nm.x(), &p.pos_w_nm.y(), &p.pos_w_nm.z(), &p.radius_nm};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(r), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 9; ++k) {
      Reply r = golden.reply;
      double* const fields[] = {&r.force_w_nn.x(),   &r.force_w_nn.y(),   &r.force_w_nn.z(),
                                &r.tip_pos_w_nm.x(), &r.tip_pos_w_nm.y(), &r.tip_pos_w_nm.z(),
                                &r.deflection_nm,    &r.energy_in_aj,     &r.energy_out_aj};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(r), DropCause::kNonFinite) << k;
    }
    for (int k = 0; k < 5; ++k) {
      Welcome w = golden.welcome;
      double* const fields[] = {&w.start_pos_w_nm.y(), &w.surface_z_w_nm, &w.force_max_nn,
                                &w.coupling_stiffness_n_m, &w.stiffness_min_n_m};
      *fields[k] = bad;
      EXPECT_EQ(cause_of(w), DropCause::kNonFinite) << k;
    }
  }
  Command huge = golden.command;  // finite, however large: not this layer's business
  huge.tip_pos_w_nm.x() = std::numeric_limits<double>::max();
  huge.tip_vel_w_nm_s.x() = -std::numeric_limits<double>::max();
  EXPECT_EQ(cause_of(huge), DropCause::kNone);
  Command negative = golden.command;
  negative.energy_in_j = -1;
  EXPECT_EQ(cause_of(negative), DropCause::kOutOfRange);
  Command first = golden.command;
  first.sequence = 0;
  EXPECT_EQ(cause_of(first), DropCause::kOutOfRange);
  // A number that is none is the cause, whatever else is out of range.
  first.control.wave_sum.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(cause_of(first), DropCause::kNonFinite);
  Reply both = golden.reply_with_features;
  both.port.energy_sent_aj = -1;
  both.model.friction_nn = std::numeric_limits<double>::infinity();
  EXPECT_EQ(cause_of(both), DropCause::kNonFinite);
}

TEST(Codec, HoldsPortControlToItsRanges) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_with = [&](auto&& change) {
    Command c = GoldenMessages{}.command_with_features;
    change(c.control);
    return codec.decode(std::span(out).first(codec.encode(c, out)), in);
  };
  const auto with_method = [&](std::uint32_t method, double scale, double impedance) {
    return cause_with([&](PortControl& p) {
      p.method = method;
      p.energy_scale_aj_j = scale;
      p.wave_impedance_n_s_m = impedance;
    });
  };
  for (std::uint32_t method = 0; method <= kMethodTwin; ++method) {
    EXPECT_EQ(with_method(method, 1, 1), DropCause::kNone) << method;
    const bool scale_needed = method == 3 || method == 4 || method == 5;
    EXPECT_EQ(with_method(method, 0, 1), scale_needed ? DropCause::kOutOfRange : DropCause::kNone) << method;
    EXPECT_EQ(with_method(method, 1, 0), method == 4 ? DropCause::kOutOfRange : DropCause::kNone) << method;
    EXPECT_EQ(with_method(method, -1, 1), DropCause::kOutOfRange) << method;
    EXPECT_EQ(with_method(method, 1, -1), DropCause::kOutOfRange) << method;
  }
  EXPECT_EQ(with_method(8, 1, 1), DropCause::kOutOfRange);
  EXPECT_EQ(with_method(UINT32_MAX, 1, 1), DropCause::kOutOfRange);
  EXPECT_EQ(cause_with([](PortControl& p) { p.energy_sent_j = -1e-300; }), DropCause::kOutOfRange);
  EXPECT_EQ(cause_with([](PortControl& p) { p.wave_energy_aj = -1e-300; }), DropCause::kOutOfRange);
  EXPECT_EQ(cause_with([](PortControl& p) { p.wave_sum = -p.wave_sum; }), DropCause::kNone);
  EXPECT_EQ(cause_with([](PortControl& p) { p = {}; }), DropCause::kNone);
}

TEST(Codec, HoldsTheParticleToItsRanges) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_with = [&](auto&& change) {
    Reply r = GoldenMessages{}.reply_with_particle;
    change(r.particle);
    return codec.decode(std::span(out).first(codec.encode(r, out)), in);
  };
  const auto none = DropCause::kNone;
  const auto bad = DropCause::kOutOfRange;
  EXPECT_EQ(cause_with([](Particle& p) { p.radius_nm = -1e-300; }), bad);
  EXPECT_EQ(cause_with([](Particle& p) { p.radius_nm = 0; }), none);
  EXPECT_EQ(cause_with([](Particle& p) { p.pos_w_nm *= -1; }), none);
  EXPECT_EQ(cause_with([](Particle& p) { p.status = ParticleStatus::kLost; }), none);
  EXPECT_EQ(cause_with([](Particle& p) { p.status = static_cast<ParticleStatus>(4); }), bad);
  EXPECT_EQ(cause_with([](Particle& p) { p = {}; }), none);
  EXPECT_TRUE(in.reply.particle.empty());
  // A reply without one does not keep that of the reply before, in either form.
  const GoldenMessages golden;
  for (const Reply* after : {&golden.reply, &golden.reply_with_history}) {
    cause_with([](Particle&) {});
    ASSERT_FALSE(in.reply.particle.empty());
    codec.decode(std::span(out).first(codec.encode(*after, out)), in);
    EXPECT_TRUE(in.reply.particle.empty());
  }
}

TEST(Codec, HoldsPortAnswerAndLocalModelToTheirRanges) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto cause_with = [&](auto&& change) {
    Reply r = GoldenMessages{}.reply_with_features;
    change(r);
    return codec.decode(std::span(out).first(codec.encode(r, out)), in);
  };
  const auto none = DropCause::kNone;
  const auto bad = DropCause::kOutOfRange;
  EXPECT_EQ(cause_with([](Reply& r) { r.port.energy_sent_aj = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.port.wave_energy_aj = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.port.wave_sum *= -1; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.stiffness_n_m = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.adhesion_nn = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.shear_stiffness_n_m = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.friction_nn = -1; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.point_w_nm *= -1; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.model = {}; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.port = {}; }), none);
  // Length 1 within 1e-6; none only if there is no model.
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1 + 0.9e-6; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1 - 0.9e-6; }), none);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1 + 1.1e-6; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1 - 1.1e-6; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w *= 1e300; }), bad);
  EXPECT_EQ(cause_with([](Reply& r) { r.model.normal_w.setZero(); }), bad);
  EXPECT_EQ(cause_with([](Reply& r) {
              r.model.normal_w.setZero();
              r.model.version = 0;
            }),
            none);
}

TEST(Codec, FieldsBeyondTheLastAreUnknownWhateverTheirTag) {
  // Two-byte tags up to 511 and beyond: only those of the list, in their shortest form.
  const auto files = golden_files();
  for (const std::size_t which : {7u, 8u}) {
    const FieldList& fields = which == 7 ? kCommandFields : kReplyFields;
    const auto known = [&](std::uint32_t number) {
      return number <= kMaxFields && (fields[number] == kFixed32 || fields[number] == kFixed64);
    };
    for (std::uint32_t number = 16; number < 300; ++number) {
      if (known(number)) continue;
      for (const std::uint32_t wire_type : {1u, 5u}) {
        Bytes payload(files[which].begin() + kHeaderBytes, files[which].end());
        const std::uint32_t tag = number << 3 | wire_type;
        payload.push_back(static_cast<std::uint8_t>((tag & 0x7f) | 0x80));
        payload.push_back(static_cast<std::uint8_t>(tag >> 7));
        payload.insert(payload.end(), wire_type == 1 ? 8 : 4, 0);
        EXPECT_EQ(decode(datagram(kGoldenTypes[which], payload)), DropCause::kMalformedField) << number;
      }
    }
  }
}

/// The fields of a datagram without byte strings, each with its tag.
std::vector<Bytes> fields_of(const Bytes& file) {
  std::vector<Bytes> fields;
  for (std::size_t at = kHeaderBytes; at < file.size();) {
    const std::size_t size = (file[at] >= 0x80 ? 2u : 1u) + ((file[at] & 7) == 1 ? 8u : 4u);
    fields.emplace_back(file.begin() + static_cast<std::ptrdiff_t>(at),
                        file.begin() + static_cast<std::ptrdiff_t>(at + size));
    at += size;
  }
  return fields;
}

TEST(Codec, EveryFieldTwiceIsMalformed) {
  const auto files = golden_files();
  for (const std::size_t which : {4u, 5u, 7u, 8u}) {
    for (const Bytes& field : fields_of(files[which])) {
      Bytes payload(files[which].begin() + kHeaderBytes, files[which].end());
      payload.insert(payload.end(), field.begin(), field.end());
      EXPECT_EQ(decode(datagram(kGoldenTypes[which], payload)), DropCause::kMalformedField)
          << kGoldenNames[which] << " tag " << int{field[0]};
    }
  }
}

TEST(Codec, ReadsTheFieldsBackwards) {
  // Out of order, so that the scan by table sees them all: also numbers of 32 and above, beside every lower
  // one.
  const GoldenMessages golden;
  const auto files = golden_files();
  Codec codec;
  Incoming in;
  for (const std::size_t which : {4u, 5u, 7u, 8u}) {
    const auto fields = fields_of(files[which]);
    Bytes payload;
    for (auto field = fields.rbegin(); field != fields.rend(); ++field)
      payload.insert(payload.end(), field->begin(), field->end());
    ASSERT_EQ(codec.decode(datagram(kGoldenTypes[which], payload), in), DropCause::kNone)
        << kGoldenNames[which];
    EXPECT_TRUE(matches(in, golden, which)) << kGoldenNames[which];
  }
}

TEST(Scan, TakesNoTagInALongerForm) {
  // 0x89 0x00 is field 1, fixed64, in two bytes; seven more make up the length of the shortest form. Protobuf
  // would see a field cut short; the scan has to see it first.
  WireFrame frame;
  EXPECT_EQ(scan(datagram(MessageType::kBye, {0x89, 0x00, 1, 0, 0, 0, 0, 0, 0}), frame),
            DropCause::kMalformedField);
  EXPECT_EQ(scan(datagram(MessageType::kBye, {0x09, 1, 0, 0, 0, 0, 0, 0, 0}), frame), DropCause::kNone);
}

TEST(Codec, WritesNothingIntoTooSmallABuffer) {
  const GoldenMessages golden;
  Codec codec;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  const auto all = golden.encoded();
  const auto try_all = [&](const auto& message, std::size_t size) {
    out.fill(0xee);
    EXPECT_EQ(codec.encode(message, std::span(out).first(size - 1)), 0u);
    EXPECT_EQ(out[size - 1], 0xee);
    EXPECT_EQ(codec.encode(message, std::span(out).first(size)), size);
  };
  try_all(golden.hello, all[0].size());
  try_all(golden.challenge, all[1].size());
  try_all(golden.welcome, all[2].size());
  try_all(golden.refuse, all[3].size());
  try_all(golden.command, all[4].size());
  try_all(golden.reply, all[5].size());
  try_all(golden.bye, all[6].size());
  try_all(golden.command_with_features, all[7].size());
  try_all(golden.reply_with_features, all[8].size());
}

/// Every field 1.
struct Full {
  template <std::uint32_t kNumber, class Value>
  void operator()(Value& value) noexcept {
    value = Value(1);
  }
  template <class Body>
  void run(const Body& body) noexcept {
    body(*this);
  }
};

// Steps and a deadband for replies are in no session together: with every other field they would be longer than a
// datagram. Nothing is written then, whatever room there is; without the one or the other all fit.
TEST(Codec, StepsAndADeadbandTogetherAreNoLongerThanADatagram) {
  Full full;
  Command c;
  visit_fields(c, full);
  visit_feature_fields(c, full);
  ASSERT_EQ(c.reply_deadband, (ReplyDeadband{1, 1}));
  const Bytes steps(kStepsBytesMost, 7);
  Codec codec;
  Bytes out(kMaxDatagramBytes + 200, 0xA5);
  for (const std::size_t room : {kMaxDatagramBytes, out.size()}) {
    EXPECT_EQ(codec.encode(c, steps, std::span(out).first(room)), 0u) << room;
    EXPECT_EQ(std::count(out.begin(), out.end(), 0xA5), static_cast<std::ptrdiff_t>(out.size()))
        << "untouched";
  }
  EXPECT_EQ(codec.encode(c, out), 219u);
  c.reply_deadband = {};
  EXPECT_EQ(codec.encode(c, steps, out), 511u);
  std::fill(out.begin(), out.end(), 0xA5);
  EXPECT_EQ(codec.encode(c, steps, std::span(out).first(kMaxDatagramBytes)), 511u);
  EXPECT_EQ(out[511], 0xA5);
}

TEST(Codec, KeepsEveryBitOfADouble) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  Command c = GoldenMessages{}.command;
  c.tip_pos_w_nm = {-0.0, std::numeric_limits<double>::denorm_min(), 0.1};
  const std::size_t n = codec.encode(c, out);
  ASSERT_EQ(codec.decode(std::span(out).first(n), in), DropCause::kNone);
  EXPECT_TRUE(std::signbit(in.command.tip_pos_w_nm.x()));
  EXPECT_EQ(in.command.tip_pos_w_nm.y(), std::numeric_limits<double>::denorm_min());
  EXPECT_EQ(in.command.tip_pos_w_nm.z(), 0.1);
}

TEST(Codec, AHelloOfAnyContentFillsTheLargestDatagram) {
  Codec codec;
  Incoming in;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  Hello hello;
  hello.nonce = 1;
  for (const bool full : {false, true}) {
    if (full) hello = GoldenMessages{}.hello;
    ASSERT_EQ(codec.encode(hello, out), kMaxDatagramBytes);
    ASSERT_EQ(codec.decode(out, in), DropCause::kNone);
    EXPECT_TRUE(same(in.hello, hello));
  }
}

TEST(Codec, NoAnswerToAHelloIsLargerThanIt) {
  Codec codec;
  std::array<std::uint8_t, kMaxDatagramBytes> out{};
  GoldenMessages largest;
  largest.welcome.scene_name.text.fill('x');
  EXPECT_LE(codec.encode(largest.challenge, out), kMaxDatagramBytes);
  EXPECT_LE(codec.encode(largest.refuse, out), kMaxDatagramBytes);
  EXPECT_LE(codec.encode(largest.welcome, out), 300u) << "as PROTOCOL.md says";
  // Nor is any reply: every field set but those of sharing.
  EXPECT_EQ(codec.encode(largest.command_with_features, out), 201u);
  EXPECT_EQ(codec.encode(largest.reply_with_features, out), 327u);
  EXPECT_EQ(codec.encode(largest.reply_with_history, out), 337u);
  Reply every = largest.reply_with_history;
  every.tip = largest.reply_with_sharing.tip;
  every.particle = largest.reply_with_particle.particle;
  EXPECT_EQ(codec.encode(every, out), 419u);
}

TEST(DropCauses, HaveNamesOfTheirOwn) {
  for (std::size_t i = 0; i < kDropCauseCount; ++i) {
    for (std::size_t j = i + 1; j < kDropCauseCount; ++j) {
      EXPECT_STRNE(name(static_cast<DropCause>(i)), name(static_cast<DropCause>(j)));
    }
  }
  EXPECT_STREQ(name(DropCause::kRateLimited), "rate_limited");
  DropCounters counters;
  counters.add(DropCause::kStale);
  counters.add(DropCause::kStale);
  EXPECT_EQ(counters[DropCause::kStale], 2u);
  EXPECT_EQ(counters.total(), 2u);
}

}  // namespace
}  // namespace telenano::link

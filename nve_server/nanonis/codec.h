#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "telenano/nve_server/nanonis/commands.h"

namespace telenano::nanonis {

/// Every frame: a command's name padded with zeros, the body's size, two fields of 16 bits; big-endian.
inline constexpr std::size_t kHeaderBytes = 40;
inline constexpr std::size_t kNameBytes = 32;
/// No reply that a slave asks for is larger: 128 names of signals are about 4 kB.
inline constexpr std::size_t kMaxBodyBytes = 1 << 18;
inline constexpr std::size_t kMaxElements = 4096;  ///< of one array

using Bytes = std::vector<std::uint8_t>;

/// A request. Numbers stand in the order of the command's letters; an N is its elements, without the count
/// (each command has at most one array, whose length follows from the others).
struct Call {
  CommandId id = CommandId::kStop;
  std::vector<double> numbers;
};

/// A reply. Where `error` is not 0, the values are worth nothing.
struct Answer {
  std::vector<double> numbers;
  std::vector<std::string> texts;  ///< of an S
  std::uint32_t error = 0;
  std::string error_text;
};

/// The two ways in which controllers report an error: the returned values zero-filled before the error
/// fields, or the error fields alone.
enum class ErrorForm : std::uint8_t { kZeroFilled, kAlone };

struct Header {
  std::string name;
  std::size_t body_bytes = 0;
  bool wants_reply = false;  ///< of a request; zero in a reply
};

/// False when this is no header: a name with bytes that are not printable or not zero after its end, a
/// negative or oversize body, something in the fields that are zero.
bool parse_header(std::span<const std::uint8_t, kHeaderBytes> bytes, Header& header);

Bytes encode_call(const Call& call, bool wants_reply = true);
Bytes encode_answer(const Command& command, const Answer& answer, ErrorForm form = ErrorForm::kZeroFilled);

/// False when the body is not exactly what the command's letters say.
bool decode_call(const Command& command, std::span<const std::uint8_t> body, Call& call);
/// The same for a reply, in either form of an error. A value that is not finite makes it false.
bool decode_answer(const Command& command, std::span<const std::uint8_t> body, Answer& answer);

}  // namespace telenano::nanonis

#include "telenano/nve_server/nanonis/codec.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace telenano::nanonis {
namespace {

class Writer {
 public:
  explicit Writer(Bytes& out) : out_(out) {}

  template <class Unsigned>
  void word(Unsigned value) {
    for (int shift = 8 * (static_cast<int>(sizeof value) - 1); shift >= 0; shift -= 8)
      out_.push_back(static_cast<std::uint8_t>(value >> shift));
  }
  void number(char letter, double value) {
    switch (letter) {
      case 'd':
        return word(std::bit_cast<std::uint64_t>(value));
      case 'f':
        return word(std::bit_cast<std::uint32_t>(static_cast<float>(value)));
      case 'i':
        return word(static_cast<std::uint32_t>(static_cast<std::int32_t>(value)));
      case 'I':
        return word(static_cast<std::uint32_t>(value));
      default:
        return word(static_cast<std::uint16_t>(value));
    }
  }
  void length(std::size_t n) { word(static_cast<std::uint32_t>(n)); }
  void text(std::string_view s) {
    length(s.size());
    out_.insert(out_.end(), s.begin(), s.end());
  }
  void texts(const std::vector<std::string>& list) {
    std::size_t total = 0;
    for (const std::string& s : list) total += 4 + s.size();
    length(total);
    length(list.size());
    for (const std::string& s : list) text(s);
  }
  /// `numbers` may end early: the rest is zero, an array empty.
  void values(std::string_view letters, const std::vector<double>& numbers,
              const std::vector<std::string>& names) {
    const std::size_t scalars = static_cast<std::size_t>(std::count_if(
        letters.begin(), letters.end(), [](char c) { return std::strchr("NFS", c) == nullptr; }));
    const std::size_t elements = numbers.size() > scalars ? numbers.size() - scalars : 0;
    std::size_t at = 0;
    const auto next = [&] { return at < numbers.size() ? numbers[at++] : 0.0; };
    for (const char letter : letters) {
      if (letter == 'S') {
        texts(names);
      } else if (letter == 'N' || letter == 'F') {
        length(elements);
        for (std::size_t i = 0; i < elements; ++i) number(letter == 'N' ? 'i' : 'f', next());
      } else {
        number(letter, next());
      }
    }
  }

 private:
  Bytes& out_;
};

class Reader {
 public:
  explicit Reader(std::span<const std::uint8_t> bytes) : bytes_(bytes) {}

  template <class Unsigned>
  bool word(Unsigned& value) {
    if (left() < sizeof value) return false;
    value = 0;
    for (std::size_t i = 0; i < sizeof value; ++i)
      value = static_cast<Unsigned>(static_cast<std::uint64_t>(value) << 8 | bytes_[at_++]);
    return true;
  }
  bool number(char letter, double& value) {
    std::uint64_t w64 = 0;
    std::uint32_t w32 = 0;
    std::uint16_t w16 = 0;
    switch (letter) {
      case 'd':
        if (!word(w64)) return false;
        value = std::bit_cast<double>(w64);
        return std::isfinite(value);
      case 'f':
        if (!word(w32)) return false;
        value = std::bit_cast<float>(w32);
        return std::isfinite(value);
      case 'i':
        if (!word(w32)) return false;
        value = static_cast<std::int32_t>(w32);
        return true;
      case 'I':
        if (!word(w32)) return false;
        value = w32;
        return true;
      default:
        if (!word(w16)) return false;
        value = w16;
        return true;
    }
  }
  /// A count or length that what is left can hold: `least` bytes for each.
  bool length(std::size_t& n, std::size_t least, std::size_t most) {
    std::uint32_t w = 0;
    if (!word(w) || w > most || w * least > left()) return false;
    n = w;
    return true;
  }
  bool text(std::string& s) {
    std::size_t n = 0;
    if (!length(n, 1, kMaxBodyBytes)) return false;
    s.assign(bytes_.begin() + static_cast<std::ptrdiff_t>(at_),
             bytes_.begin() + static_cast<std::ptrdiff_t>(at_ + n));
    at_ += n;
    return true;
  }
  bool texts(std::vector<std::string>& list) {
    std::size_t total = 0, count = 0;
    if (!length(total, 1, kMaxBodyBytes) || !length(count, 4, kMaxElements) || total > left()) return false;
    const std::size_t end = at_ + total;
    list.resize(count);
    for (std::string& s : list) {
      if (!text(s) || at_ > end) return false;
    }
    return at_ == end;
  }
  bool values(std::string_view letters, std::vector<double>& numbers, std::vector<std::string>* names) {
    const auto take = [&](char letter) {
      double value = 0;
      if (!number(letter, value)) return false;
      numbers.push_back(value);
      return true;
    };
    for (const char letter : letters) {
      if (letter == 'S') {
        if (names == nullptr || !texts(*names)) return false;
      } else if (letter == 'N' || letter == 'F') {
        std::size_t n = 0;
        if (!length(n, 4, kMaxElements)) return false;
        for (std::size_t i = 0; i < n; ++i) {
          if (!take(letter == 'N' ? 'i' : 'f')) return false;
        }
      } else if (!take(letter)) {
        return false;
      }
    }
    return true;
  }
  /// The end of every reply: status, length and text of the description, and nothing after.
  bool error(Answer& answer) { return word(answer.error) && text(answer.error_text) && left() == 0; }
  std::size_t left() const { return bytes_.size() - at_; }

 private:
  std::span<const std::uint8_t> bytes_;
  std::size_t at_ = 0;
};

Bytes frame(std::string_view name, bool wants_reply, const Bytes& body) {
  Bytes out(name.begin(), name.end());
  out.resize(kNameBytes, 0);
  Writer writer(out);
  writer.length(body.size());
  writer.word(static_cast<std::uint16_t>(wants_reply ? 1 : 0));
  writer.word(std::uint16_t{0});
  out.insert(out.end(), body.begin(), body.end());
  return out;
}

}  // namespace

bool parse_header(std::span<const std::uint8_t, kHeaderBytes> bytes, Header& header) {
  const auto name_end = std::find(bytes.begin(), bytes.begin() + kNameBytes, 0);
  header.name.assign(bytes.begin(), name_end);
  const auto printable = [](std::uint8_t c) { return c > 0x20 && c < 0x7f; };
  if (header.name.empty() || !std::all_of(bytes.begin(), name_end, printable)) return false;
  if (!std::all_of(name_end, bytes.begin() + kNameBytes, [](std::uint8_t c) { return c == 0; })) return false;
  Reader reader(bytes.subspan(kNameBytes));
  std::uint32_t size = 0;
  std::uint16_t reply = 0, zero = 0;
  if (!reader.word(size) || !reader.word(reply) || !reader.word(zero)) return false;
  if (size > kMaxBodyBytes || reply > 1 || zero != 0) return false;
  header.body_bytes = size;
  header.wants_reply = reply == 1;
  return true;
}

Bytes encode_call(const Call& call, bool wants_reply) {
  const Command& c = command(call.id);
  Bytes body;
  Writer(body).values(c.arguments, call.numbers, {});
  return frame(c.name, wants_reply, body);
}

Bytes encode_answer(const Command& c, const Answer& answer, ErrorForm form) {
  Bytes body;
  Writer writer(body);
  if (answer.error == 0) {
    writer.values(c.returns, answer.numbers, answer.texts);
  } else if (form == ErrorForm::kZeroFilled) {
    writer.values(c.returns, {}, {});
  }
  writer.word(answer.error);
  writer.text(answer.error_text);
  return frame(c.name, false, body);
}

bool decode_call(const Command& c, std::span<const std::uint8_t> body, Call& call) {
  call.id = c.id;
  call.numbers.clear();
  Reader reader(body);
  return reader.values(c.arguments, call.numbers, nullptr) && reader.left() == 0;
}

bool decode_answer(const Command& c, std::span<const std::uint8_t> body, Answer& answer) {
  // Error fields alone: only where there is an error, and the description fills the body to its end. A reply
  // with values could look like this by chance only if its first value were an error and its second a length
  // that fits; no returned values of these commands can while their own error field is 0.
  Reader alone(body);
  answer = {};
  if (alone.error(answer) && answer.error != 0) return true;
  answer = {};
  Reader reader(body);
  return reader.values(c.returns, answer.numbers, &answer.texts) && reader.error(answer);
}

}  // namespace telenano::nanonis

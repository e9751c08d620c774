#pragma once

#include <cstdint>
#include <span>

#include "telenano/nve_server/nanonis/codec.h"

namespace telenano::nanonis {

/// Cuts a stream of bytes into frames. After kBroken the stream is lost: where the next frame begins cannot
/// be known.
class FrameReader {
 public:
  enum class Status : std::uint8_t { kNeedMore, kFrame, kBroken };

  void feed(std::span<const std::uint8_t> bytes);
  /// kFrame: `header` and `body` (until the next call) are one whole frame.
  Status next(Header& header, std::span<const std::uint8_t>& body);
  void clear() noexcept;
  std::size_t waiting() const noexcept { return buffer_.size() - at_; }

 private:
  Bytes buffer_;
  std::size_t at_ = 0;
  bool broken_ = false;
};

}  // namespace telenano::nanonis

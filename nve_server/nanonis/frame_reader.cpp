#include "telenano/nve_server/nanonis/frame_reader.h"

namespace telenano::nanonis {

void FrameReader::feed(std::span<const std::uint8_t> bytes) {
  if (broken_) return;
  buffer_.erase(buffer_.begin(), buffer_.begin() + static_cast<std::ptrdiff_t>(at_));
  at_ = 0;
  buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
}

FrameReader::Status FrameReader::next(Header& header, std::span<const std::uint8_t>& body) {
  if (broken_) return Status::kBroken;
  const auto rest = std::span<const std::uint8_t>(buffer_).subspan(at_);
  if (rest.size() < kHeaderBytes) return Status::kNeedMore;
  if (!parse_header(rest.first<kHeaderBytes>(), header)) {
    broken_ = true;
    return Status::kBroken;
  }
  if (rest.size() < kHeaderBytes + header.body_bytes) return Status::kNeedMore;
  body = rest.subspan(kHeaderBytes, header.body_bytes);
  at_ += kHeaderBytes + header.body_bytes;
  return Status::kFrame;
}

void FrameReader::clear() noexcept {
  buffer_.clear();
  at_ = 0;
  broken_ = false;
}

}  // namespace telenano::nanonis

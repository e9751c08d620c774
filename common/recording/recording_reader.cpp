#include "telenano/common/recording/recording_reader.h"

#include <algorithm>

#include "telenano/common/recording/recording_source.h"

namespace telenano::recording {

class RecordingReader::Impl {
 public:
  std::filesystem::path path;
  std::unique_ptr<RecordingSource> source;
};

RecordingReader::RecordingReader(const std::filesystem::path& path)
    : impl_(std::make_unique<Impl>(Impl{path, open_recording(path)})) {}
RecordingReader::RecordingReader(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RecordingReader RecordingReader::isolated(const std::filesystem::path& path) {
  return RecordingReader(std::make_unique<Impl>(Impl{path, open_recording_isolated(path)}));
}
RecordingReader::~RecordingReader() = default;
RecordingReader::RecordingReader(RecordingReader&&) noexcept = default;
RecordingReader& RecordingReader::operator=(RecordingReader&&) noexcept = default;

const std::filesystem::path& RecordingReader::path() const noexcept {
  return impl_->path;
}
std::size_t RecordingReader::rows() const noexcept {
  return static_cast<std::size_t>(impl_->source->facts().rows);
}
bool RecordingReader::cut_short() const noexcept {
  return impl_->source->facts().cut_short;
}
bool RecordingReader::closed() const noexcept {
  return impl_->source->facts().closed;
}
std::uint64_t RecordingReader::rows_dropped() const noexcept {
  return impl_->source->facts().rows_dropped;
}
bool RecordingReader::has(const std::string& column) const {
  const auto& all = impl_->source->facts().columns;
  return std::find(all.begin(), all.end(), column) != all.end();
}
std::vector<std::string> RecordingReader::columns() const {
  return impl_->source->facts().columns;
}
std::string RecordingReader::unit(const std::string& column) const {
  return impl_->source->attribute(column, "unit");
}
std::string RecordingReader::description(const std::string& column) const {
  return impl_->source->attribute(column, "description");
}
std::vector<double> RecordingReader::read(const std::string& column, std::size_t component) const {
  return impl_->source->read(column, component);
}
void RecordingReader::read_samples(std::size_t first, std::span<Sample> samples) const {
  impl_->source->read_samples(first, samples);
}
std::vector<Event> RecordingReader::events() const {
  return impl_->source->events();
}
std::vector<DatagramRow> RecordingReader::datagrams() const {
  return impl_->source->datagrams();
}
std::vector<MarkRow> RecordingReader::marks() const {
  return impl_->source->marks();
}
std::vector<StatePieceRow> RecordingReader::state_pieces() const {
  return impl_->source->state_pieces();
}
std::vector<std::pair<std::string, std::string>> RecordingReader::configuration() const {
  return impl_->source->configuration();
}
std::string RecordingReader::configuration(const std::string& key) const {
  for (auto& [name, text] : impl_->source->configuration()) {
    if (name == key) return text;
  }
  return {};
}

}  // namespace telenano::recording

#include "common/recording/recording_reader.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#include "common/base/error.h"
#include "common/recording/hdf5_handle.h"

namespace telenano::recording {
namespace {

/// Number of rows of an open dataset.
hsize_t dataset_rows(hid_t dataset) {
  const Handle space(H5Dget_space(dataset), H5Sclose);
  std::array<hsize_t, 8> size{};
  const int rank = H5Sget_simple_extent_ndims(space.get());
  if (rank < 1 || rank > 2 || H5Sget_simple_extent_dims(space.get(), size.data(), nullptr) < 0) return 0;
  return size[0];
}

herr_t collect_link(hid_t, const char* name, const H5L_info_t*, void* names) {
  static_cast<std::vector<std::string>*>(names)->emplace_back(name);
  return 0;
}

herr_t collect_attribute(hid_t, const char* name, const H5A_info_t*, void* names) {
  static_cast<std::vector<std::string>*>(names)->emplace_back(name);
  return 0;
}

}  // namespace

class RecordingReader::Impl {
 public:
  explicit Impl(const std::filesystem::path& path) : path_(path) {
    prepare_hdf5();
    open();
    check_format();
    Progress progress;
    if (!read_progress(file_.get(), progress)) broken("has no readable /progress");
    closed_ = plain_ && progress.closed != 0;
    cut_short_ = progress.closed != 1;
    rows_dropped_ = static_cast<std::uint64_t>(std::max<std::int64_t>(progress.rows_dropped, 0));
    list_columns();
    // A recovered file has been cut to its confirmed rows already, so the same rule serves every file.
    rows_ = static_cast<std::size_t>(std::max<std::int64_t>(progress.rows, 0));
    for (const std::string& column : columns_)
      rows_ = std::min<std::size_t>(rows_, dataset_rows(open_column(column).get()));
    events_ = static_cast<std::size_t>(std::max<std::int64_t>(progress.events, 0));
  }

  const std::filesystem::path& path() const { return path_; }
  std::size_t rows() const { return rows_; }
  bool closed() const { return closed_; }
  bool cut_short() const { return cut_short_; }
  std::uint64_t rows_dropped() const { return rows_dropped_; }
  const std::vector<std::string>& columns() const { return columns_; }
  bool has(const std::string& column) const {
    return std::find(columns_.begin(), columns_.end(), column) != columns_.end();
  }

  std::string attribute(const std::string& column, const char* name) const {
    std::string text;
    read_text_attribute(open_column(column).get(), name, text);
    return text;
  }

  std::vector<double> read(const std::string& column, std::size_t component) const {
    const Handle dataset = open_column(column);
    const Handle space(H5Dget_space(dataset.get()), H5Sclose);
    std::array<hsize_t, 2> size{0, 1};
    const int rank = H5Sget_simple_extent_ndims(space.get());
    if (rank < 1 || rank > 2) broken("column '" + column + "' is not a table");
    H5Sget_simple_extent_dims(space.get(), size.data(), nullptr);
    if (component >= size[1]) {
      throw UserError(path_.string() + ": column '" + column + "' has " + std::to_string(size[1]) +
                      " component(s), number " + std::to_string(component) + " was asked for");
    }
    std::vector<double> values(rows_);
    if (rows_ == 0) return values;
    const std::array<hsize_t, 2> start{0, component};
    const std::array<hsize_t, 2> count{rows_, 1};
    const Handle memory(H5Screate_simple(1, count.data(), nullptr), H5Sclose);
    if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr) < 0 ||
        H5Dread(dataset.get(), H5T_NATIVE_DOUBLE, memory.get(), space.get(), H5P_DEFAULT, values.data()) <
            0) {
      broken("column '" + column + "' cannot be read: " + hdf5_reason());
    }
    return values;
  }

  void read_samples(std::size_t first, std::span<Sample> samples) const {
    if (first > rows_ || samples.size() > rows_ - first)
      broken("has no row " + std::to_string(first + samples.size()));
    std::fill(samples.begin(), samples.end(), Sample{});
    if (samples.empty()) return;
    std::vector<unsigned char> buffer;
    for (const Column& column : sample_columns()) {
      if (!has(column.name)) continue;
      const Handle dataset = open_column(column.name);
      const Handle space(H5Dget_space(dataset.get()), H5Sclose);
      std::array<hsize_t, 2> size{0, 1};
      const int rank = H5Sget_simple_extent_ndims(space.get());
      if (rank < 1 || rank > 2) broken(std::string("column '") + column.name + "' is not a table");
      H5Sget_simple_extent_dims(space.get(), size.data(), nullptr);
      if (size[1] != column.components) {
        broken(std::string("column '") + column.name + "' has " + std::to_string(size[1]) +
               " component(s), " + std::to_string(column.components) + " were expected");
      }
      const std::array<hsize_t, 2> start{first, 0};
      const std::array<hsize_t, 2> count{samples.size(), size[1]};
      buffer.resize(samples.size() * column.bytes());
      const Handle memory(H5Screate_simple(rank, count.data(), nullptr), H5Sclose);
      if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr) <
              0 ||
          H5Dread(dataset.get(), memory_type(column.type), memory.get(), space.get(), H5P_DEFAULT,
                  buffer.data()) < 0) {
        broken(std::string("column '") + column.name + "' cannot be read: " + hdf5_reason());
      }
      for (std::size_t i = 0; i < samples.size(); ++i) {
        std::memcpy(reinterpret_cast<unsigned char*>(&samples[i]) + column.offset,
                    buffer.data() + i * column.bytes(), column.bytes());
      }
    }
  }

  std::vector<Event> events() const {
    const Handle dataset(H5Dopen2(file_.get(), kEventsDataset, H5P_DEFAULT), H5Dclose);
    if (!dataset) broken("has no /events");
    const hsize_t count = std::min<hsize_t>(events_, dataset_rows(dataset.get()));
    std::vector<Event> events(count);
    if (count == 0) return events;
    const hsize_t start = 0;
    const Handle type = event_type(false);
    const Handle space(H5Dget_space(dataset.get()), H5Sclose);
    const Handle memory(H5Screate_simple(1, &count, nullptr), H5Sclose);
    if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, &start, nullptr, &count, nullptr) < 0 ||
        H5Dread(dataset.get(), type.get(), memory.get(), space.get(), H5P_DEFAULT, events.data()) < 0) {
      broken("/events cannot be read: " + hdf5_reason());
    }
    return events;
  }

  /// Nothing confirms them: a writer that was killed may have left rows that lie beyond the samples, or were
  /// never filled (tick 0 again).
  std::vector<DatagramRow> datagrams() const {
    if (H5Lexists(file_.get(), kDatagramsDataset, H5P_DEFAULT) <= 0 || rows_ == 0) return {};
    const Handle dataset(H5Dopen2(file_.get(), kDatagramsDataset, H5P_DEFAULT), H5Dclose);
    std::vector<DatagramRow> rows(dataset ? dataset_rows(dataset.get()) : 0);
    if (!rows.empty() && H5Dread(dataset.get(), datagram_type().get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, rows.data()) < 0)
      broken("/datagrams cannot be read: " + hdf5_reason());
    Sample last;
    read_samples(rows_ - 1, std::span(&last, 1));
    std::size_t good = 0;
    while (good < rows.size() && rows[good].tick <= last.tick && rows[good].came_ns != 0 &&
           (good == 0 || rows[good].tick >= rows[good - 1].tick))
      ++good;
    rows.resize(good);
    return rows;
  }

  std::vector<std::pair<std::string, std::string>> configuration() const {
    const Handle group(H5Gopen2(file_.get(), kConfigurationGroup, H5P_DEFAULT), H5Gclose);
    if (!group) broken("has no /configuration");
    std::vector<std::string> names;
    hsize_t from = 0;
    H5Aiterate2(group.get(), H5_INDEX_NAME, H5_ITER_INC, &from, collect_attribute, &names);
    std::vector<std::pair<std::string, std::string>> entries;
    for (const std::string& name : names) {
      std::string text;
      if (read_text_attribute(group.get(), name.c_str(), text)) entries.emplace_back(name, std::move(text));
    }
    return entries;
  }

 private:
  [[noreturn]] void broken(const std::string& why) const { throw UserError(path_.string() + ": " + why); }

  void open() {
    const std::string name = path_.string();
    std::error_code error;
    if (!std::filesystem::exists(path_, error)) broken("no such file");
    if (!std::filesystem::is_regular_file(path_, error)) broken("is not a file");
    file_ = Handle(H5Fopen(name.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    plain_ = static_cast<bool>(file_);
    // Refused when the writer is at work or was killed: then as one of many readers beside a writer.
    if (!file_)
      file_ = Handle(H5Fopen(name.c_str(), H5F_ACC_RDONLY | H5F_ACC_SWMR_READ, H5P_DEFAULT), H5Fclose);
    if (!file_) broken("not a recording that can be read: " + hdf5_reason());
  }

  void check_format() {
    std::string format;
    if (!read_text_attribute(file_.get(), "format", format) || format != kFormatName) {
      broken(std::string("an HDF5 file, but not a Telenano recording (attribute 'format' is not '") +
             kFormatName + "')");
    }
    std::uint32_t version = 0;
    const Handle attribute(H5Aopen(file_.get(), "format_version", H5P_DEFAULT), H5Aclose);
    if (!attribute || H5Aread(attribute.get(), H5T_NATIVE_UINT32, &version) < 0 || version == 0) {
      broken("has no readable format_version");
    }
    if (version > kFormatVersion) {
      broken("is of format version " + std::to_string(version) + "; this program reads up to " +
             std::to_string(kFormatVersion));
    }
  }

  void list_columns() {
    const Handle group(H5Gopen2(file_.get(), kSamplesGroup, H5P_DEFAULT), H5Gclose);
    if (!group) broken("has no /samples");
    H5Literate(group.get(), H5_INDEX_NAME, H5_ITER_INC, nullptr, collect_link, &columns_);
    if (columns_.empty()) broken("has no column in /samples");
  }

  Handle open_column(const std::string& column) const {
    Handle dataset;
    if (has(column)) {
      dataset = Handle(
          H5Dopen2(file_.get(), (std::string(kSamplesGroup) + "/" + column).c_str(), H5P_DEFAULT), H5Dclose);
    }
    if (!dataset) broken("has no column '" + column + "'");
    return dataset;
  }

  std::filesystem::path path_;
  Handle file_;
  bool plain_ = false;
  bool closed_ = false;
  bool cut_short_ = true;
  std::uint64_t rows_dropped_ = 0;
  std::size_t rows_ = 0;
  std::size_t events_ = 0;
  std::vector<std::string> columns_;
};

RecordingReader::RecordingReader(const std::filesystem::path& path) : impl_(std::make_unique<Impl>(path)) {}
RecordingReader::~RecordingReader() = default;
RecordingReader::RecordingReader(RecordingReader&&) noexcept = default;
RecordingReader& RecordingReader::operator=(RecordingReader&&) noexcept = default;

const std::filesystem::path& RecordingReader::path() const noexcept {
  return impl_->path();
}
std::size_t RecordingReader::rows() const noexcept {
  return impl_->rows();
}
bool RecordingReader::cut_short() const noexcept {
  return impl_->cut_short();
}
bool RecordingReader::closed() const noexcept {
  return impl_->closed();
}
std::uint64_t RecordingReader::rows_dropped() const noexcept {
  return impl_->rows_dropped();
}
bool RecordingReader::has(const std::string& column) const {
  return impl_->has(column);
}
std::vector<std::string> RecordingReader::columns() const {
  return impl_->columns();
}
std::string RecordingReader::unit(const std::string& column) const {
  return impl_->attribute(column, "unit");
}
std::string RecordingReader::description(const std::string& column) const {
  return impl_->attribute(column, "description");
}
std::vector<double> RecordingReader::read(const std::string& column, std::size_t component) const {
  return impl_->read(column, component);
}
void RecordingReader::read_samples(std::size_t first, std::span<Sample> samples) const {
  impl_->read_samples(first, samples);
}
std::vector<Event> RecordingReader::events() const {
  return impl_->events();
}
std::vector<DatagramRow> RecordingReader::datagrams() const {
  return impl_->datagrams();
}
std::vector<std::pair<std::string, std::string>> RecordingReader::configuration() const {
  return impl_->configuration();
}
std::string RecordingReader::configuration(const std::string& key) const {
  for (auto& [name, text] : impl_->configuration()) {
    if (name == key) return text;
  }
  return {};
}

}  // namespace telenano::recording

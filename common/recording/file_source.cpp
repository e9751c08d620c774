#include <algorithm>
#include <array>
#include <cstring>

#include "telenano/common/base/error.h"
#include "telenano/common/recording/hdf5_handle.h"
#include "telenano/common/recording/recording_source.h"

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

/// Columns by today's names. A soft link is another name of a column that is there too.
herr_t collect_column(hid_t, const char* name, const H5L_info_t* link, void* names) {
  if (link->type == H5L_TYPE_SOFT) return 0;
  std::string column(name);
  for (const RenamedColumn& renamed : renamed_columns()) {
    if (column == renamed.former) column = renamed.name;
  }
  static_cast<std::vector<std::string>*>(names)->push_back(std::move(column));
  return 0;
}

herr_t collect_attribute(hid_t, const char* name, const H5A_info_t*, void* names) {
  static_cast<std::vector<std::string>*>(names)->emplace_back(name);
  return 0;
}

/// Does the dataset keep its rows in this very file? HDF5 would follow it to any other.
bool is_inside(hid_t dataset) {
  const Handle creation(H5Dget_create_plist(dataset), H5Pclose);
  return creation && H5Pget_external_count(creation.get()) == 0 &&
         H5Pget_layout(creation.get()) != H5D_VIRTUAL;
}

/// Somebody may have repacked a recording; we never do.
bool is_packed(hid_t dataset) {
  const Handle creation(H5Dget_create_plist(dataset), H5Pclose);
  return creation && H5Pget_nfilters(creation.get()) > 0;
}

/// The best compression of HDF5's filters (deflate) makes 1032 bytes of one.
constexpr std::uintmax_t kBytesPerByteMax = 1032;
constexpr std::uintmax_t kUnconfirmedChunkRows = 1024;  // as the writer makes them

/// A reader beside a writer may see a block half written and reads it again, after 1, 2, 4 … ns. HDF5's own
/// limit of 100 such waits is never reached: over a damaged block it slept for ever. These are 8 ms in all; a
/// writer needs microseconds.
constexpr unsigned kReadAttempts = 23;

class FileSource final : public RecordingSource {
 public:
  explicit FileSource(const std::filesystem::path& path) : path_(path) {
    prepare_hdf5();
    open();
    check_format();
    Progress progress;
    if (!read_progress(file_.get(), progress)) broken("has no readable /progress");
    facts_.closed = plain_ && progress.closed != 0;
    facts_.cut_short = progress.closed != 1;
    facts_.rows_dropped = static_cast<std::uint64_t>(std::max<std::int64_t>(progress.rows_dropped, 0));
    list_columns();
    // A recovered file has been cut to its confirmed rows already, so the same rule serves every file.
    facts_.rows = static_cast<std::uint64_t>(std::max<std::int64_t>(progress.rows, 0));
    bool packed = false;
    for (const std::string& column : facts_.columns) {
      const Handle dataset = open_column(column);
      facts_.rows = std::min<std::uint64_t>(facts_.rows, dataset_rows(dataset.get()));
      packed = packed || is_packed(dataset.get());
    }
    // Rows that were never written take no place in a file, but all of it in memory.
    const std::uintmax_t rows_max = std::filesystem::file_size(path_) * (packed ? kBytesPerByteMax : 1);
    if (facts_.rows > rows_max)
      broken("says that it has " + std::to_string(facts_.rows) + " rows, more than fit into it");
    events_ = static_cast<std::size_t>(std::max<std::int64_t>(progress.events, 0));
  }

  const RecordingFacts& facts() const override { return facts_; }

  std::string attribute(const std::string& column, const std::string& name) const override {
    std::string text;
    read_text_attribute(open_column(column).get(), name.c_str(), text);
    return text;
  }

  std::vector<double> read(const std::string& column, std::size_t component) const override {
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
    std::vector<double> values(rows());
    if (rows() == 0) return values;
    const std::array<hsize_t, 2> start{0, component};
    const std::array<hsize_t, 2> count{rows(), 1};
    const Handle memory(H5Screate_simple(1, count.data(), nullptr), H5Sclose);
    if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, start.data(), nullptr, count.data(), nullptr) < 0 ||
        H5Dread(dataset.get(), H5T_NATIVE_DOUBLE, memory.get(), space.get(), H5P_DEFAULT, values.data()) <
            0) {
      broken("column '" + column + "' cannot be read: " + hdf5_reason());
    }
    return values;
  }

  void read_samples(std::size_t first, std::span<Sample> samples) const override {
    if (first > rows() || samples.size() > rows() - first)
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

  std::vector<Event> events() const override {
    const Handle dataset(H5Dopen2(file_.get(), kEventsDataset, H5P_DEFAULT), H5Dclose);
    if (!dataset) broken("has no /events");
    const Handle space(H5Dget_space(dataset.get()), H5Sclose);
    if (H5Sget_simple_extent_ndims(space.get()) != 1 || !is_inside(dataset.get()))
      broken("has no readable /events");
    const hsize_t count = std::min<hsize_t>(events_, dataset_rows(dataset.get()));
    const std::uintmax_t bytes_max =
        std::filesystem::file_size(path_) * (is_packed(dataset.get()) ? kBytesPerByteMax : 1);
    if (count > bytes_max / sizeof(Event))
      broken("says that it has " + std::to_string(count) + " events, more than fit into it");
    std::vector<Event> events(count);
    if (count == 0) return events;
    const hsize_t start = 0;
    const Handle type = event_type(false);
    const Handle memory(H5Screate_simple(1, &count, nullptr), H5Sclose);
    if (H5Sselect_hyperslab(space.get(), H5S_SELECT_SET, &start, nullptr, &count, nullptr) < 0 ||
        H5Dread(dataset.get(), type.get(), memory.get(), space.get(), H5P_DEFAULT, events.data()) < 0) {
      broken("/events cannot be read: " + hdf5_reason());
    }
    for (Event& event : events) event.text.back() = '\0';
    return events;
  }

  /// Nothing confirms them: a writer that was killed may have left rows that lie beyond the samples, or were
  /// never filled (tick 0 again).
  std::vector<DatagramRow> datagrams() const override {
    std::vector<DatagramRow> rows_read = read_unconfirmed<DatagramRow>(kDatagramsDataset, datagram_type());
    if (rows_read.empty()) return rows_read;
    Sample last;
    read_samples(rows() - 1, std::span(&last, 1));
    std::size_t good = 0;
    while (good < rows_read.size() && rows_read[good].tick <= last.tick && rows_read[good].came_ns != 0 &&
           (good == 0 || rows_read[good].tick >= rows_read[good - 1].tick))
      ++good;
    rows_read.resize(good);
    return rows_read;
  }

  std::vector<MarkRow> marks() const override {
    std::vector<MarkRow> rows_read = read_unconfirmed<MarkRow>(kMarksDataset, mark_type());
    if (rows_read.empty()) return rows_read;
    Sample last;
    read_samples(rows() - 1, std::span(&last, 1));
    std::size_t good = 0;
    while (good < rows_read.size() && rows_read[good].time_s <= last.time_s &&
           (good == 0 ? rows_read[good].column == MarkRow::kPlace
                      : rows_read[good].time_s >= rows_read[good - 1].time_s))
      ++good;
    rows_read.resize(good);
    return rows_read;
  }

  std::vector<StatePieceRow> state_pieces() const override {
    std::vector<StatePieceRow> rows_read =
        read_unconfirmed<StatePieceRow>(kStatePiecesDataset, state_piece_type());
    if (rows_read.empty()) return rows_read;
    Sample last;
    read_samples(rows() - 1, std::span(&last, 1));
    std::size_t good = 0;
    while (good < rows_read.size() && rows_read[good].tick <= last.tick && rows_read[good].total != 0 &&
           rows_read[good].size <= StatePieceRow::kBytes &&
           (good == 0 || rows_read[good].tick >= rows_read[good - 1].tick))
      ++good;
    rows_read.resize(good);
    return rows_read;
  }

  std::vector<std::pair<std::string, std::string>> configuration() const override {
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
  /// All rows of a dataset that /progress does not count; none where there is no such dataset.
  template <class Row>
  std::vector<Row> read_unconfirmed(const char* name, const Handle& type) const {
    if (H5Lexists(file_.get(), name, H5P_DEFAULT) <= 0 || rows() == 0) return {};
    const Handle dataset(H5Dopen2(file_.get(), name, H5P_DEFAULT), H5Dclose);
    if (!dataset) broken(std::string("has no readable ") + name);
    const Handle space(H5Dget_space(dataset.get()), H5Sclose);
    if (H5Sget_simple_extent_ndims(space.get()) != 1 || !is_inside(dataset.get()))
      broken(std::string("has no readable ") + name);
    const hsize_t count = dataset_rows(dataset.get());
    const std::uintmax_t bytes_max =
        std::filesystem::file_size(path_) * (is_packed(dataset.get()) ? kBytesPerByteMax : 1);
    // A chunk may be larger than what a killed writer had to put into it.
    if (count > bytes_max / sizeof(Row) + kUnconfirmedChunkRows)
      broken("says that it has " + std::to_string(count) + " rows of " + name + ", more than fit into it");
    std::vector<Row> rows_read(count);
    if (count > 0 && H5Dread(dataset.get(), type.get(), H5S_ALL, H5S_ALL, H5P_DEFAULT, rows_read.data()) < 0)
      broken(std::string(name) + " cannot be read: " + hdf5_reason());
    return rows_read;
  }

  bool has(const std::string& column) const {
    return std::find(facts_.columns.begin(), facts_.columns.end(), column) != facts_.columns.end();
  }
  std::size_t rows() const { return static_cast<std::size_t>(facts_.rows); }
  [[noreturn]] void broken(const std::string& why) const { throw UserError(path_.string() + ": " + why); }

  void open() {
    const std::string name = path_.string();
    std::error_code error;
    if (!std::filesystem::exists(path_, error)) broken("no such file");
    if (!std::filesystem::is_regular_file(path_, error)) broken("is not a file");
    file_ = Handle(H5Fopen(name.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose);
    plain_ = static_cast<bool>(file_);
    // Refused when the writer is at work or was killed: then as one of many readers beside a writer.
    if (!file_) {
      const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
      H5Pset_metadata_read_attempts(access.get(), kReadAttempts);
      file_ = Handle(H5Fopen(name.c_str(), H5F_ACC_RDONLY | H5F_ACC_SWMR_READ, access.get()), H5Fclose);
    }
    if (file_) return;
    const std::string reason = hdf5_reason();
    broken(H5Fis_hdf5(name.c_str()) > 0 ? "not a recording that can be read: " + reason
                                        : "not a recording: no HDF5 file");
  }

  void check_format() {
    std::string format;
    if (!read_text_attribute(file_.get(), "format", format) || format != kFormatName) {
      broken(std::string("an HDF5 file, but not a Telenano recording (attribute 'format' is not '") +
             kFormatName + "')");
    }
    std::uint32_t version = 0;
    const Handle attribute(H5Aopen(file_.get(), "format_version", H5P_DEFAULT), H5Aclose);
    if (!attribute || !is_single(attribute.get()) ||
        H5Aread(attribute.get(), H5T_NATIVE_UINT32, &version) < 0 || version == 0) {
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
    H5Literate(group.get(), H5_INDEX_NAME, H5_ITER_INC, nullptr, collect_column, &facts_.columns);
    if (facts_.columns.empty()) broken("has no column in /samples");
  }

  Handle open_column(const std::string& column) const {
    Handle dataset;
    if (has(column)) {
      dataset =
          Handle(H5Dopen2(file_.get(), column_path(file_.get(), column).c_str(), H5P_DEFAULT), H5Dclose);
    }
    if (!dataset) broken("has no column '" + column + "'");
    if (!is_inside(dataset.get())) broken("keeps column '" + column + "' in other files");
    return dataset;
  }

  std::filesystem::path path_;
  Handle file_;
  bool plain_ = false;
  RecordingFacts facts_;
  std::size_t events_ = 0;
};

}  // namespace

std::unique_ptr<RecordingSource> open_recording(const std::filesystem::path& path) {
  return std::make_unique<FileSource>(path);
}

}  // namespace telenano::recording

#include "telenano/common/recording/recording_file.h"

#include <unistd.h>

#include <array>
#include <cstring>
#include <ctime>

#include "telenano/common/base/error.h"

namespace telenano::recording {
namespace {

constexpr hsize_t kEventChunkRows = 256;
constexpr hsize_t kStatePieceChunkRows = 64;

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  ::gmtime_r(&now, &parts);
  std::array<char, 32> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &parts);
  return text.data();
}

/// Extendable in rows, `components` wide (a plain column when 1).
Handle create_extendable(hid_t file, const std::string& name, hid_t type, std::size_t components,
                         hsize_t chunk_rows) {
  const int rank = components > 1 ? 2 : 1;
  const std::array<hsize_t, 2> size{0, components};
  const std::array<hsize_t, 2> limit{H5S_UNLIMITED, components};
  const std::array<hsize_t, 2> chunk{chunk_rows, components};
  const Handle space(H5Screate_simple(rank, size.data(), limit.data()), H5Sclose);
  const Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_chunk(creation.get(), rank, chunk.data());
  return {H5Dcreate2(file, name.c_str(), type, space.get(), H5P_DEFAULT, creation.get(), H5P_DEFAULT),
          H5Dclose};
}

std::string path_of(const Column& column) {
  return std::string(kSamplesGroup) + "/" + column.name;
}

}  // namespace

RecordingFile::RecordingFile(const std::filesystem::path& path, bool overwrite,
                             const Configuration& configuration)
    : name_(path.string()) {
  prepare_hdf5();
  std::error_code ignored;
  const bool existed = std::filesystem::exists(path, ignored);
  if (existed) {
    if (std::filesystem::is_directory(path, ignored))
      throw UserError(name_ + ": is a directory; a file name is expected");
    if (!overwrite) throw UserError(name_ + ": exists already; choose another name or pass --overwrite");
    if (std::filesystem::is_regular_file(path, ignored)) {
      const int fd = lock_recording(name_.c_str());
      if (fd < 0)
        throw UserError(name_ + ": cannot be overwritten; it is being recorded now, or not writable");
      ::close(fd);
    }
  }
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  H5Pset_libver_bounds(access.get(), H5F_LIBVER_LATEST, H5F_LIBVER_LATEST);  // what SWMR needs
  const unsigned mode = overwrite ? H5F_ACC_TRUNC : H5F_ACC_EXCL;
  file_ = Handle(H5Fcreate(name_.c_str(), mode, H5P_DEFAULT, access.get()), H5Fclose);
  const auto forget_stump = [&] {  // a name without a recording would only be in the way of the next attempt
    if (!existed && std::filesystem::is_regular_file(path, ignored)) std::filesystem::remove(path, ignored);
  };
  if (!file_) {
    const std::string reason = hdf5_reason();
    forget_stump();
    throw UserError(name_ + ": cannot be created: " + reason);
  }
  lock_fd_ = lock_recording(name_.c_str());
  try {
    create(configuration);
  } catch (...) {
    abandon();
    forget_stump();
    throw;
  }
}

RecordingFile::~RecordingFile() {
  abandon();
}

void RecordingFile::create(const Configuration& configuration) {
  create_configuration(configuration);
  create_datasets();
  // Every object exists by now: nothing may be created once readers are allowed in.
  if (H5Fflush(file_.get(), H5F_SCOPE_LOCAL) < 0 || H5Fstart_swmr_write(file_.get()) < 0) {
    throw UserError(name_ + ": cannot be written: " + hdf5_reason());
  }
  open_datasets();
  if (!confirm(0)) throw UserError(error_);
}

void RecordingFile::create_configuration(const Configuration& configuration) {
  bool good = write_text_attribute(file_.get(), "format", kFormatName);
  {
    const Handle space(H5Screate(H5S_SCALAR), H5Sclose);
    const Handle version(
        H5Acreate2(file_.get(), "format_version", H5T_STD_U32LE, space.get(), H5P_DEFAULT, H5P_DEFAULT),
        H5Aclose);
    good = good && version && H5Awrite(version.get(), H5T_NATIVE_UINT32, &kFormatVersion) >= 0;
  }
  unsigned major = 0;
  unsigned minor = 0;
  unsigned release = 0;
  H5get_libversion(&major, &minor, &release);
  std::vector<std::pair<std::string, std::string>> entries{
      {"title", configuration.title},
      {"program", configuration.program},
      {"git_commit", configuration.git_commit},
      {"command_line", configuration.command_line},
      {"start_time_utc", configuration.start_time_utc.empty() ? utc_now() : configuration.start_time_utc},
      {"scene_name", configuration.scene_name},
      {"scene_hash", configuration.scene_hash},
      {"scene_text", configuration.scene_text},
      {"station_text", configuration.station_text},
      {"seed", configuration.seed},
      {"rate_hz", configuration.rate_hz > 0 ? std::to_string(configuration.rate_hz) : ""},
      {"hdf5_version", std::to_string(major) + "." + std::to_string(minor) + "." + std::to_string(release)}};
  entries.insert(entries.end(), configuration.extra.begin(), configuration.extra.end());
  const Handle group(H5Gcreate2(file_.get(), kConfigurationGroup, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT),
                     H5Gclose);
  good = good && group;
  for (const auto& [key, text] : entries) {
    if (text.empty() || key.empty() || H5Aexists(group.get(), key.c_str()) > 0) continue;
    good = good && write_text_attribute(group.get(), key.c_str(), text);
  }
  if (!good) throw UserError(name_ + ": cannot be written: " + hdf5_reason());
}

void RecordingFile::create_datasets() {
  const Handle group(H5Gcreate2(file_.get(), kSamplesGroup, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
  bool good = static_cast<bool>(group);
  for (const Column& column : sample_columns()) {
    const Handle dataset = create_extendable(file_.get(), path_of(column), file_type(column.type),
                                             column.components, kChunkRows);
    good = good && dataset && write_text_attribute(dataset.get(), "unit", column.unit) &&
           write_text_attribute(dataset.get(), "description", column.description);
  }
  for (const RenamedColumn& column : renamed_columns()) {
    good = good && H5Lcreate_soft(column.name, group.get(), column.former, H5P_DEFAULT, H5P_DEFAULT) >= 0;
  }
  const Handle packed = event_type(true);
  const Handle events = create_extendable(file_.get(), kEventsDataset, packed.get(), 1, kEventChunkRows);
  good =
      good && events && write_text_attribute(events.get(), "description", "what happened, and at which tick");
  const Handle datagrams =
      create_extendable(file_.get(), kDatagramsDataset, datagram_type().get(), 1, kChunkRows);
  good = good && datagrams &&
         write_text_attribute(
             datagrams.get(), "description",
             "every datagram that came: tick and time (ns, station clock), a reply's number "
             "and the command it answers, the last logged step by then, type, cause if dropped, the state's "
             "hash after that step, the newest step that had come, and the log's breaks (PROTOCOL.md)");
  const Handle marks = create_extendable(file_.get(), kMarksDataset, mark_type().get(), 1, kChunkRows);
  good = good && marks &&
         write_text_attribute(marks.get(), "description",
                              "how the sample changed: where its nodes are (column 4294967295; row 0 to 6: "
                              "columns, rows, dx, dy, x and y of the first, height of a plane; nm, frame W), "
                              "then nodes with their new height (nm, frame W)");
  const Handle pieces =
      create_extendable(file_.get(), kStatePiecesDataset, state_piece_type().get(), 1, kStatePieceChunkRows);
  good =
      good && pieces &&
      write_text_attribute(pieces.get(), "description",
                           "the server's states that a twin took up, in pieces as they came: tick, the last "
                           "logged step then, the state's hash after it, and its bytes (PROTOCOL.md)");

  const hsize_t fields = kProgressFields;
  const Handle space(H5Screate_simple(1, &fields, nullptr), H5Sclose);
  const Handle creation(H5Pcreate(H5P_DATASET_CREATE), H5Pclose);
  H5Pset_alloc_time(creation.get(), H5D_ALLOC_TIME_EARLY);  // its place never moves, so one write confirms
  const Handle progress(H5Dcreate2(file_.get(), kProgressDataset, H5T_STD_I64LE, space.get(), H5P_DEFAULT,
                                   creation.get(), H5P_DEFAULT),
                        H5Dclose);
  good = good && progress &&
         write_text_attribute(
             progress.get(), "description",
             "confirmed by the writer: rows of /samples, rows of /events, rows dropped, 1 if closed or 2 if "
             "recovered");
  if (!good) throw UserError(name_ + ": cannot be written: " + hdf5_reason());
}

void RecordingFile::open_datasets() {
  std::size_t widest = 0;
  bool good = true;
  for (const Column& column : sample_columns()) {
    columns_.emplace_back(H5Dopen2(file_.get(), path_of(column).c_str(), H5P_DEFAULT), H5Dclose);
    good = good && columns_.back();
    widest = std::max(widest, column.bytes());
  }
  gathered_.resize(widest * kChunkRows);
  events_ = Handle(H5Dopen2(file_.get(), kEventsDataset, H5P_DEFAULT), H5Dclose);
  event_type_ = event_type(false);
  datagrams_ = Handle(H5Dopen2(file_.get(), kDatagramsDataset, H5P_DEFAULT), H5Dclose);
  datagram_type_ = datagram_type();
  marks_ = Handle(H5Dopen2(file_.get(), kMarksDataset, H5P_DEFAULT), H5Dclose);
  mark_type_ = mark_type();
  state_pieces_ = Handle(H5Dopen2(file_.get(), kStatePiecesDataset, H5P_DEFAULT), H5Dclose);
  state_piece_type_ = state_piece_type();
  progress_ = Handle(H5Dopen2(file_.get(), kProgressDataset, H5P_DEFAULT), H5Dclose);
  if (!good || !events_ || !datagrams_ || !marks_ || !state_pieces_ || !progress_)
    throw UserError(name_ + ": cannot be written: " + hdf5_reason());
}

bool RecordingFile::append(std::span<const Sample> samples) {
  const auto table = sample_columns();
  for (std::size_t c = 0; c < table.size(); ++c) {
    const Column& column = table[c];
    const std::size_t bytes = column.bytes();
    for (std::size_t row = 0; row < samples.size(); ++row) {
      std::memcpy(gathered_.data() + row * bytes,
                  reinterpret_cast<const std::byte*>(&samples[row]) + column.offset, bytes);
    }
    if (!append_to(columns_[c].get(), memory_type(column.type), rows_, samples.size(), column.components,
                   gathered_.data())) {
      return false;
    }
  }
  rows_ += samples.size();
  return true;
}

bool RecordingFile::append(std::span<const Event> events) {
  if (!append_to(events_.get(), event_type_.get(), event_rows_, events.size(), 1, events.data()))
    return false;
  event_rows_ += events.size();
  return true;
}

bool RecordingFile::append(std::span<const DatagramRow> datagrams) {
  if (!append_to(datagrams_.get(), datagram_type_.get(), datagram_rows_, datagrams.size(), 1,
                 datagrams.data()))
    return false;
  datagram_rows_ += datagrams.size();
  return true;
}

bool RecordingFile::append(std::span<const MarkRow> marks) {
  if (!append_to(marks_.get(), mark_type_.get(), mark_rows_, marks.size(), 1, marks.data())) return false;
  mark_rows_ += marks.size();
  return true;
}

bool RecordingFile::append(std::span<const StatePieceRow> pieces) {
  if (!append_to(state_pieces_.get(), state_piece_type_.get(), state_piece_rows_, pieces.size(), 1,
                 pieces.data()))
    return false;
  state_piece_rows_ += pieces.size();
  return true;
}

bool RecordingFile::append_to(hid_t dataset, hid_t type, std::uint64_t at, std::size_t count,
                              std::size_t components, const void* data) {
  if (count == 0) return true;
  const int rank = components > 1 ? 2 : 1;
  const std::array<hsize_t, 2> size{at + count, components};
  const std::array<hsize_t, 2> start{at, 0};
  const std::array<hsize_t, 2> extent{count, components};
  if (H5Dset_extent(dataset, size.data()) < 0) return fail("grow");
  const Handle file_space(H5Dget_space(dataset), H5Sclose);
  const Handle memory_space(H5Screate_simple(rank, extent.data(), nullptr), H5Sclose);
  if (!file_space || !memory_space ||
      H5Sselect_hyperslab(file_space.get(), H5S_SELECT_SET, start.data(), nullptr, extent.data(), nullptr) <
          0 ||
      H5Dwrite(dataset, type, memory_space.get(), file_space.get(), H5P_DEFAULT, data) < 0) {
    return fail("write");
  }
  return true;
}

bool RecordingFile::confirm(std::uint64_t rows_dropped) {
  if (H5Fflush(file_.get(), H5F_SCOPE_LOCAL) < 0) return fail("flush");
  return write_progress(rows_dropped, false);
}

bool RecordingFile::write_progress(std::uint64_t rows_dropped, bool closed) {
  const std::array<std::int64_t, kProgressFields> fields{
      static_cast<std::int64_t>(rows_), static_cast<std::int64_t>(event_rows_),
      static_cast<std::int64_t>(rows_dropped), closed ? 1 : 0};
  if (H5Dwrite(progress_.get(), H5T_NATIVE_INT64, H5S_ALL, H5S_ALL, H5P_DEFAULT, fields.data()) < 0 ||
      H5Dflush(progress_.get()) < 0) {
    return fail("confirm");
  }
  return true;
}

bool RecordingFile::close(std::uint64_t rows_dropped) {
  if (!confirm(rows_dropped) || !write_progress(rows_dropped, true)) return false;
  bool good = progress_.reset();
  for (Handle& column : columns_) good = column.reset() && good;
  good = events_.reset() && good;
  good = datagrams_.reset() && good;
  good = marks_.reset() && good;
  good = state_pieces_.reset() && good;
  good = file_.reset() && good;
  if (!good) return fail("close");
  abandon();
  return true;
}

void RecordingFile::abandon() noexcept {
  for (Handle& column : columns_) column.abandon();
  columns_.clear();
  events_.abandon();
  datagrams_.abandon();
  marks_.abandon();
  state_pieces_.abandon();
  progress_.abandon();
  file_.abandon();
  if (lock_fd_ >= 0) ::close(lock_fd_);
  lock_fd_ = -1;
}

bool RecordingFile::fail(const char* what) {
  error_ = name_ + ": recording stopped, cannot " + what + " the file: " + hdf5_reason();
  return false;
}

}  // namespace telenano::recording

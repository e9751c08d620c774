#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "telenano/common/recording/hdf5_handle.h"
#include "telenano/common/recording/recorder.h"
#include "telenano/common/recording/sample.h"
#include "telenano/common/recording/state_piece_row.h"

namespace telenano::recording {

/// The file that a Recorder writes, without its thread: creation, appending, confirming, closing. One thread
/// at a time. Nothing but the constructor throws; after a false, error() says why and the file must be
/// abandoned.
class RecordingFile {
 public:
  RecordingFile(const std::filesystem::path& path, bool overwrite, const Configuration& configuration);
  ~RecordingFile();
  RecordingFile(const RecordingFile&) = delete;
  RecordingFile& operator=(const RecordingFile&) = delete;

  static constexpr std::size_t kChunkRows = 1024;

  /// At most kChunkRows at a time.
  bool append(std::span<const Sample> samples);
  bool append(std::span<const Event> events);
  bool append(std::span<const DatagramRow> datagrams);
  bool append(std::span<const MarkRow> marks);
  bool append(std::span<const StatePieceRow> pieces);
  /// Hands everything appended to the operating system, then confirms it in /progress. In this order, so a
  /// process that is killed in between has confirmed only what is really in the file.
  bool confirm(std::uint64_t rows_dropped);
  bool close(std::uint64_t rows_dropped);
  /// After an error: lets go of the file without asking HDF5 to write anything more.
  void abandon() noexcept;

  std::uint64_t rows() const noexcept { return rows_; }
  const std::string& error() const noexcept { return error_; }

 private:
  void create(const Configuration& configuration);
  void create_configuration(const Configuration& configuration);
  void create_datasets();
  void open_datasets();
  bool append_to(hid_t dataset, hid_t type, std::uint64_t at, std::size_t count, std::size_t components,
                 const void* data);
  bool write_progress(std::uint64_t rows_dropped, bool closed);
  bool fail(const char* what);

  std::string name_;
  std::string error_;
  int lock_fd_ = -1;
  Handle file_;
  std::vector<Handle> columns_;
  Handle events_;
  Handle event_type_;
  Handle datagrams_;
  Handle datagram_type_;
  Handle marks_;
  Handle mark_type_;
  Handle state_pieces_;
  Handle state_piece_type_;
  Handle progress_;
  std::vector<std::byte> gathered_;
  std::uint64_t rows_ = 0;
  std::uint64_t event_rows_ = 0;
  std::uint64_t datagram_rows_ = 0;
  std::uint64_t mark_rows_ = 0;
  std::uint64_t state_piece_rows_ = 0;
};

}  // namespace telenano::recording

#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/recording/datagram_row.h"
#include "telenano/common/recording/mark_row.h"
#include "telenano/common/recording/sample.h"
#include "telenano/common/recording/state_piece_row.h"

namespace telenano::recording {

/// What makes a file explain itself: stored as fixed-size string attributes of /configuration. Empty texts
/// are left out.
struct Configuration {
  std::string title{};       ///< one line for people
  std::string program{};     ///< name and version of the program
  std::string git_commit{};  ///< of the build, when known
  std::string command_line{};
  std::string start_time_utc{};  ///< ISO 8601; filled in by the recorder when empty
  std::string scene_name{};
  std::string scene_hash{};
  std::string scene_text{};    ///< the whole scene file
  std::string station_text{};  ///< the whole station configuration
  std::string seed{};
  double rate_hz = 0;  ///< of the station loop; 0 = unknown
  std::vector<std::pair<std::string, std::string>>
      extra{};  ///< anything else: method, scales, server address ...
};

struct RecorderOptions {
  std::filesystem::path path{};
  bool overwrite = false;          ///< an existing file is refused otherwise
  std::size_t queue_rows = 16384;  ///< rows that may wait while the disk is busy: 4 s at 4 kHz, 6 MB
  std::size_t queue_events = 1024;
  std::size_t queue_datagrams = 16384;
  std::size_t queue_state_pieces = 2048;  ///< a second of them as fast as a station asks: 1 MB
  /// More are not written in one recording (63 MB): a replay ends where the first one is missing.
  std::uint64_t state_pieces_most = 131'072;
  double flush_period_s = 0.25;  ///< at most this much, twice, is lost when the process is killed
  /// Asked by the recorder's thread before each flush: how the sample has changed since. Left out: it does not.
  /// Their times are the recorder's.
  std::function<void(std::vector<MarkRow>& rows)> newest_marks{};
  /// Told once, from the recorder's thread, when writing fails (a full disk): one line. The loop is not
  /// disturbed.
  std::function<void(const std::string&)> on_failure{};
};

/// Writes a recording (HDF5, single writer and multiple readers). The loop pushes rows, which never waits,
/// locks or allocates; a thread of its own writes and flushes them. Every flush leaves a file that our reader
/// opens as it is, whatever happens to the process afterwards; README.md in this folder says how. When
/// writing fails, recording stops, every further row is counted as dropped, on_failure is called once, and
/// nothing else happens.
class Recorder {
 public:
  /// Creates the file, every dataset and attribute in it, and starts the thread. Throws UserError when that
  /// fails. Construct it before the calling thread becomes real-time: the writer must not inherit that.
  Recorder(const RecorderOptions& options, const Configuration& configuration);
  /// Closes.
  ~Recorder();
  Recorder(const Recorder&) = delete;
  Recorder& operator=(const Recorder&) = delete;

  /// The loop's thread only. False when the row was dropped (and counted).
  bool push(const Sample& sample) noexcept;
  bool push(const Event& event) noexcept;
  bool push(const DatagramRow& row) noexcept;
  bool push(const StatePieceRow& row) noexcept;

  /// Writes what is still queued and closes the file. Not from the loop. Does nothing the second time.
  void close();

  /// Any thread.
  bool failed() const noexcept;
  std::string failure() const;  ///< empty while all is well
  std::uint64_t rows_written() const noexcept;
  std::uint64_t rows_dropped() const noexcept;  ///< queue full, or recording has stopped
  std::uint64_t events_dropped() const noexcept;
  std::uint64_t datagrams_dropped() const noexcept;
  std::uint64_t state_pieces_dropped() const noexcept;  ///< also those beyond state_pieces_most

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

/// An event with its text cut to the field.
Event make_event(std::int64_t tick, double time_s, std::uint32_t code, const char* text,
                 std::uint32_t value = 0) noexcept;

}  // namespace telenano::recording

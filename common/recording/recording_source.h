#pragma once

// Only for the files of this folder.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "telenano/common/recording/datagram_row.h"
#include "telenano/common/recording/mark_row.h"
#include "telenano/common/recording/sample.h"
#include "telenano/common/recording/state_piece_row.h"

namespace telenano::recording {

/// What is the same of every reader of a recording, told when it is opened.
struct RecordingFacts {
  std::uint64_t rows = 0;
  bool closed = false;
  bool cut_short = true;
  std::uint64_t rows_dropped = 0;
  std::vector<std::string> columns;
};

/// Where RecordingReader gets a recording from: the file itself, or a process that reads it.
class RecordingSource {
 public:
  virtual ~RecordingSource() = default;
  virtual const RecordingFacts& facts() const = 0;
  virtual std::string attribute(const std::string& column, const std::string& name) const = 0;
  virtual std::vector<double> read(const std::string& column, std::size_t component) const = 0;
  virtual void read_samples(std::size_t first, std::span<Sample> samples) const = 0;
  virtual std::vector<Event> events() const = 0;
  virtual std::vector<DatagramRow> datagrams() const = 0;
  virtual std::vector<MarkRow> marks() const = 0;
  virtual std::vector<StatePieceRow> state_pieces() const = 0;
  virtual std::vector<std::pair<std::string, std::string>> configuration() const = 0;
};

/// Reads with HDF5 in this process. Throws UserError.
std::unique_ptr<RecordingSource> open_recording(const std::filesystem::path& path);
/// Reads with HDF5 in a process of its own: a crash there is a RunError here.
std::unique_ptr<RecordingSource> open_recording_isolated(const std::filesystem::path& path);

}  // namespace telenano::recording

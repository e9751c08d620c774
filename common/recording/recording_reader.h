#pragma once

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

/// Reads a recording as it is: closed, still being written, or left behind by a killed process. Only complete
/// rows are shown: columns of unequal length are cut to the shortest, and to what the writer had confirmed.
/// Every error is a UserError of one line that names the file.
class RecordingReader {
 public:
  /// With HDF5 in this process: for files that this program has written.
  explicit RecordingReader(const std::filesystem::path& path);
  /// With HDF5 in a process of its own: for files from anywhere. What the library does to itself over a
  /// damaged or hostile file is a RunError then. Forks: call it while no other thread works with HDF5.
  static RecordingReader isolated(const std::filesystem::path& path);
  ~RecordingReader();
  RecordingReader(RecordingReader&&) noexcept;
  RecordingReader& operator=(RecordingReader&&) noexcept;

  const std::filesystem::path& path() const noexcept;
  std::size_t rows() const noexcept;
  /// False when the file is still being written or its writer was killed.
  bool closed() const noexcept;
  /// True when the writer did not end in good order, whether the file has been recovered since or not.
  bool cut_short() const noexcept;
  std::uint64_t rows_dropped() const noexcept;  ///< as the writer counted

  bool has(const std::string& column) const;
  std::vector<std::string> columns() const;
  std::string unit(const std::string& column) const;
  std::string description(const std::string& column) const;
  /// One component of one column. Integers beyond 2^53 are rounded.
  std::vector<double> read(const std::string& column, std::size_t component = 0) const;
  /// Whole rows, from `first` on; a field without a column of its name keeps its default. first + size must
  /// not be more than rows().
  void read_samples(std::size_t first, std::span<Sample> samples) const;
  std::vector<Event> events() const;
  /// Of the ticks that are shown; empty for recordings made before there were any.
  std::vector<DatagramRow> datagrams() const;
  /// How the sample changed within the rows that are shown; empty where it did not, and for recordings made
  /// before this was written. By rising time; what they say of nodes is not checked.
  std::vector<MarkRow> marks() const;
  /// Of the ticks that are shown; empty where no state was taken up, and for recordings made before this was
  /// written. Their bytes are not checked.
  std::vector<StatePieceRow> state_pieces() const;

  /// Text of a key of /configuration; empty when there is none.
  std::string configuration(const std::string& key) const;
  std::vector<std::pair<std::string, std::string>> configuration() const;

 private:
  class Impl;
  explicit RecordingReader(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace telenano::recording

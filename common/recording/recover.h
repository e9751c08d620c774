#pragma once

#include <cstdint>
#include <filesystem>

namespace telenano::recording {

struct Recovered {
  bool was_closed = false;  ///< there was nothing to do; the file was not touched
  std::uint64_t rows = 0;
  std::uint64_t events = 0;
  std::uint64_t rows_cut = 0;  ///< incomplete rows removed from the longest column
};

/// Makes a recording whose writer was killed open plainly in every HDF5 program: clears the flags that say it
/// is still being written, cuts all columns to the complete rows, and proves it by a plain open. Refuses a
/// file that is being written now. Throws UserError for what is not a recording, RunError when the repair
/// fails. HDF5 works in a process of its own (RecordingReader::isolated says why and when).
Recovered recover(const std::filesystem::path& path);
/// The same with HDF5 in this process: where it is already one of its own.
Recovered recover_here(const std::filesystem::path& path);

}  // namespace telenano::recording
